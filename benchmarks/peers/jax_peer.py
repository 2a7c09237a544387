"""JAX (jit, grad) on the processor: generations of rays, packed into arrays of fixed sizes.

Rays that go on are packed densely, into as many slots as this scene needs. Each generation is a
call of its own. What was tried and is slower:

- a tree of 31 nodes for each pixel: it compiled for minutes and ran for seconds;
- all generations in one call: hits and shadows were computed anew wherever they are used;
- tiles of the image in a loop (`lax.map`) with generations in another (`lax.scan`): 118 ms for the
  image and 457 ms for the gradient, where this took 96 and 278.
"""

from functools import partial

import common
import numpy as np
import wavefront as w

PIXELS = w.SIZE * w.SIZE
# Slots of each generation after the first; this scene needs 33163, 22892, 22635 and 22566
SLOTS = (34816, 24576, 24576, 24576)


class Jax(common.Peer):
    """The image and its gradient."""

    def __init__(self) -> None:
        import jax

        self.parameters, self.step, tables = w.flat_parameters(), 0, w.Tables()
        jnp = jax.numpy
        primary = jax.jit(lambda parameters: w.primary(jnp, tables, parameters, jnp.arange(PIXELS)))
        shade = jax.jit(partial(w.shade, jnp, tables))
        add = jax.jit(lambda image, place, light: image.at[:, place].add(light))

        @partial(jax.jit, static_argnums=0)
        def pack(slots, weight, place, index, p, children):
            direction, share, into = (
                jnp.concatenate(pair, -1) for pair in zip(*children, strict=True)
            )
            (chosen,) = jnp.nonzero(share, size=slots, fill_value=share.size)
            there = chosen < share.size
            chosen = jnp.where(there, chosen, 0)
            parent = chosen % place.size
            share = jnp.where(there, weight[parent] * share[chosen], 0)
            return (
                share,
                place[parent],
                p[:, parent],
                direction[:, chosen],
                index[parent],
                into[chosen],
            )

        def image(parameters):
            weight, place = jnp.ones(PIXELS), jnp.arange(PIXELS)
            no = jnp.zeros(PIXELS, bool)
            rays = *primary(parameters), no.astype(np.int32) - 1, no
            total = jnp.zeros((3, PIXELS))
            for slots in (*SLOTS, None):
                light, *children, p, index = shade(parameters, *rays)
                total = add(total, place, weight * light)
                if slots is not None:
                    weight, place, *rays = pack(slots, weight, place, index, p, children)
            return total

        mean_square = jax.jit(lambda image: (image**2).mean())
        total = jax.jit(lambda image: image.sum())
        self.calls = {
            "image": image,
            "gradient": jax.grad(lambda parameters: mean_square(image(parameters))),
            "sums": jax.grad(lambda parameters: total(image(parameters))),
        }

    def call(self, name: str) -> np.ndarray:
        """Make a call, with one parameter a little moved each time."""
        self.step += 1
        parameters = self.parameters.copy()
        parameters[0] += 1e-6 * self.step
        return np.asarray(self.calls[name](parameters))

    def image(self):
        return self.call("image").T.reshape(w.SIZE, w.SIZE, 3)

    def gradient(self) -> list[float]:
        return self.call("gradient").tolist()

    def sums(self) -> dict[str, float]:
        found = self.call("sums")
        return {name: float(found[place]) for name, place in common.PROBES.items()}


if __name__ == "__main__":
    common.serve(Jax)
