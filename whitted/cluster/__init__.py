"""Work for many machines, on Dask's scheduler: pictures, data sets of pictures, starts of fits.

    render, sweep, fit      what users call      (picture.py, dataset.py, starts.py)
        |  tasks, and what they share
        v
    engine.py               a few tasks at a time to the scheduler; three tries; here without one
        |  work.py: pickled once, opened once in each process
        v
    a task on a worker      a function of a module (bands.py, pictures.py, trials.py); it writes its
                            chunk (store.py, pyramid.py), or returns pixels or numbers

`client=None` does the same on this machine, and does not import Dask.
"""

from .dataset import SweepResult, sweep
from .picture import render
from .starts import fit

__all__ = ["SweepResult", "fit", "render", "sweep"]
