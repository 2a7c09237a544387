"""What the tests of the cluster share: a small scene, and tasks that workers can import."""

import os
import signal

import whitted as wt

IOR, X = "materials.glass.ior", "spheres.ball.center.x"
VARY = {IOR: (1.3, 1.8), X: (-0.2, 0.2)}


def ball(precision="single"):
    """A glass ball on checkers, of 12 x 10 pixels."""
    glass = wt.Material("glass", reflection=1, refraction=1, ior=1.5, fresnel=True)
    board = wt.Checkerboard(color=(0.1, 0.1, 0.4), size=0.5)
    floor = wt.Material("floor", color=(0.8, 0.7, 0.6), checker=board)
    return wt.Scene(
        camera=wt.Camera(position=(0, 0.8, 3), look_at=(0, 0, 0), fov=45, resolution=(12, 10)),
        spheres=[wt.Sphere("ball", center=(0, 0, 0), radius=0.6, material=glass)],
        planes=[wt.Plane("floor", normal=(0, 1, 0), offset=0.6, material=floor)],
        lights=[wt.PointLight("key", position=(1, 3, 2), intensity=(1, 1, 1))],
        ambient=(0.2, 0.2, 0.2),
        max_depth=4,
        precision=precision,
    )


def matte():
    """A red ball, lit from the side, before a plain background."""
    return wt.Scene(
        camera=wt.Camera(position=(0, 0, 4), look_at=(0, 0, 0), fov=50, resolution=(32, 24)),
        spheres=[
            wt.Sphere(
                "ball",
                center=(0, 0, 0),
                radius=0.5,
                material=wt.Material("red", color=(0.8, 0.3, 0.1)),
            )
        ],
        lights=[wt.PointLight("key", position=(3, 2, 3), intensity=(1, 1, 1))],
        background=(0.1, 0.2, 0.3),
        ambient=(0.4, 0.4, 0.4),
        max_depth=1,
    )


def contents(folder):
    """The bytes of all files of a folder, by their names."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def doubled(shared, task):
    """A task that does nothing but say that it was done."""
    return shared * task


def picky(shared, task):
    """A task that is refused for one number."""
    if task == 3:
        raise ValueError(f"{shared}: no task 3 here\nand more")
    return task


def deadly(shared, task):
    """A task for which the system ends the worker, as where memory is short."""
    if task == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return task


def threads(shared, task):
    """The number of Dr.Jit's threads."""
    import drjit as dr

    return dr.thread_count()
