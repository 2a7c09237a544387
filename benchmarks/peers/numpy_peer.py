"""NumPy: a generation of rays at a time, without derivatives."""

import common
import numpy as np
import wavefront as w


class NumPy(common.Peer):
    """The image, in single precision."""

    def __init__(self) -> None:
        self.tables, self.parameters, self.step = w.Tables(), w.flat_parameters(), 0

    def trace(self, image, parameters, o, d, weight, place, source, inward, depth: int) -> None:
        """Add a generation's light to the image, then trace what is reflected and refracted."""
        radiance, *children, p, index = w.shade(np, self.tables, parameters, o, d, source, inward)
        for c in range(3):
            image[c] += np.bincount(place, weight * radiance[c], w.SIZE * w.SIZE)
        if depth == w.DEPTH:
            return
        for direction, share, into in children:
            chosen = np.flatnonzero(share)
            if chosen.size:
                packed = (
                    p[:, chosen],
                    direction[:, chosen],
                    (weight * share)[chosen],
                    place[chosen],
                    index[chosen],
                    into[chosen],
                )
                self.trace(image, parameters, *packed, depth + 1)

    def image(self):
        self.step += 1
        parameters = self.parameters.copy()
        parameters[0] += 1e-6 * self.step
        places = np.arange(w.SIZE * w.SIZE)
        o, d = w.primary(np, self.tables, parameters, places)
        image = np.zeros((3, places.size))
        no = np.zeros(places.size, bool)
        self.trace(
            image,
            parameters,
            o,
            d,
            np.ones(places.size, np.float32),
            places,
            no.astype(np.int32) - 1,
            no,
            1,
        )
        return image.T.reshape(w.SIZE, w.SIZE, 3).astype(np.float32)


if __name__ == "__main__":
    common.serve(NumPy)
