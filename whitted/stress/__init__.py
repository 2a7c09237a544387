"""The stress suite: cases that are hard for ray tracers, with known answers."""
