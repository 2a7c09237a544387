"""Taichi on the processor, by taichi_tracer.py: scalar code for a pixel, in two threads."""

import common
import numpy as np
import simd_peer


class Taichi(common.Peer):
    """The image."""

    def __init__(self) -> None:
        import taichi as ti

        ti.init(arch=ti.cpu, cpu_max_num_threads=2, offline_cache=False, log_level=ti.ERROR)
        import taichi_tracer as tracer

        self.trace = tracer.trace
        numbers = simd_peer.numbers(common.scene())
        self.view, self.shapes = numbers[:18].reshape(6, 3), numbers[18:].reshape(tracer.SHAPES, 12)
        self.picture = np.zeros((tracer.SIZE, tracer.SIZE, 3), np.float32)

    def image(self):
        self.trace(self.view, self.shapes, self.picture)
        return self.picture


if __name__ == "__main__":
    common.serve(Taichi)
