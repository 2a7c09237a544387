"""This project, without edges or with them, or its kernels alone: ours.py plain|boundary|kernel"""

import sys

import common


class Ours(common.Peer):
    """The image and its gradient, by calls as users make them."""

    def __init__(self, boundary: bool) -> None:
        import drjit as dr

        import whitted as wt

        self.dr, self.wt, self.boundary = dr, wt, boundary
        self.scene = wt.load_scene(common.SCENE)

    def changed(self) -> dict:
        """The parameters, one of them a little moved, as in an optimisation."""
        parameters = self.scene.parameters(*common.NAMES)
        parameters["spheres.sphere0.center"] += 1e-6
        self.dr.eval(parameters)
        return parameters

    def image(self):
        image = self.wt.render(self.scene.replace(self.changed()), boundary=self.boundary)
        self.dr.eval(image)
        self.dr.sync_thread()
        return image

    def gradient(self, loss=None) -> list[float]:
        dr, parameters = self.dr, self.changed()
        dr.enable_grad(parameters)
        image = self.wt.render(self.scene.replace(parameters), boundary=self.boundary)
        dr.backward(loss(image) if loss else dr.mean(dr.square(image), axis=None))
        return common.flat(dr.grad(parameters))

    def sums(self) -> dict[str, float]:
        found = self.gradient(lambda image: self.dr.sum(image, axis=None))
        return {name: found[place] for name, place in common.PROBES.items()}


class Kernel(Ours):
    """The time that the kernels of plain calls run."""

    def __init__(self) -> None:
        super().__init__(False)

    def timed(self, call):
        from whitted.measure.timing import recorded

        with recorded() as kernels:
            result = call()
        self.milliseconds = kernels.run_seconds * 1e3
        return result

    def image(self):
        return self.timed(super().image)

    def gradient(self, loss=None) -> list[float]:
        return self.timed(lambda: super(Kernel, self).gradient(loss))


if __name__ == "__main__":
    what = sys.argv[1]
    common.serve(Kernel if what == "kernel" else lambda: Ours(what == "boundary"))
