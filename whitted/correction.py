"""What edges add to a band's pixels, kept for the derivatives of those: in forward and in reverse mode."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from functools import cached_property, partial

import drjit as dr
import numpy as np
from drjit.llvm import ad

from . import probe, wavefront
from .chain import Path
from .derivative import Edge
from .edges import Crossings, Extra, Pairs, Samples, beside, deposit, joined, stretches, take, walk_order
from .events import CREASE, Event
from .film import Film
from .geometry import Array
from .region import FAINT, LANES, Band, aligned, chunks, fetched, lanes, number, rows
from .scene import Shape
from .trace import Limits

# Names of the fields of an edge's path and event
PARTS = tuple(tuple(part.name for part in fields(kind)) for kind in (Path, Event))
TERMS = ("both", "interior", "boundary")
# Into how many pieces what lies beside one of several edges between two samples is cut, at most
PIECES = 4
WEIGHTS = (".reflection", ".refraction")


@dataclass(frozen=True)
class Moving:
    """Points on edges, each with what it changes in two pixels when the level function there grows."""

    x: np.ndarray
    y: np.ndarray
    pixel: np.ndarray  # (2, N)
    change: np.ndarray  # (2, N), in units of the jump
    jump: np.ndarray  # (3, N)
    edge: dict[str, np.ndarray]


@dataclass
class Correction:
    """What makes a band's pixels those of its regular samples and edges, and not of the samples alone."""

    band: Band
    weights: Array | None = None  # what the band's regular samples still count for, row by row of samples
    extra: list[Extra] = field(default_factory=list)
    edges: list[Moving] = field(default_factory=list)

    def seen(self, wrt: dict) -> tuple[dict, dict]:
        """The parameters `wrt` without weights so small that edges in what they reflect or refract are not found, and those."""
        least = FAINT / self.band.side**2
        unseen = {name: value for name, value in wrt.items() if name.endswith(WEIGHTS) and abs(value.numpy()[0]) < least}
        return {name: value for name, value in wrt.items() if name not in unseen}, unseen

    def regular(self, seen: dict, unseen: dict) -> Iterator[tuple[tuple[Shape, dict, Film, Limits, dict], Array | None]]:
        """For each kernel call: what it takes first, with parameters among its inputs, and what each sample counts for."""
        band = self.band
        for film, names, weights in ((band.inner, seen, self.weights), (band.finer, unseen, None)):
            if names:
                yield (band.shape, band.parameters, film, band.limits, names), weights

    def extras(self, wrt: dict) -> Iterator[tuple[Extra, tuple[Shape, dict, Array, Limits]]]:
        """The extra samples, no more at once than a kernel takes, with the inputs that kernels take first."""
        if not self.extra or not wrt:
            return
        whole = joined(self.extra)
        order = np.argsort(whole.order, kind="stable")
        # Derivatives by a weight need rays that have little of it
        dim = not any(name.endswith(WEIGHTS) for name in wrt)
        for part in chunks(len(order), LANES):
            extra = take(whole, order[part])
            yield extra, self.band.leaving_out_dim(extra.beside & dim)

    def tangent(self, wrt: dict, tangents: dict, terms: str) -> Array:
        """The pixels' derivative along the tangents of the parameters `wrt`."""
        band = self.band
        pixels = aligned(np.zeros(1, number(band.real)), band.rows * band.resolution[0] * 3)
        image = pixels.numpy()
        if terms != "boundary":
            seen, unseen = self.seen(wrt)
            for first, weights in self.regular(seen, unseen):
                slopes = {name: tangents[name] for name in first[-1]}
                image += wavefront.image_jvp(*first, slopes, weights).numpy()
            for extra, inputs in self.extras(seen):
                slopes, (x, y) = {name: tangents[name] for name in seen}, band.lanes(extra.x, extra.y)
                slope = probe.samples_jvp(*inputs, seen, slopes, x, y)
                deposit(image, extra.pixel, *(rows(fetched(slope), slice(len(extra.x))) * extra.weight))
        if terms != "interior":
            for edges in self.edges:
                x, y = band.lanes(edges.x, edges.y)
                slope = probe.levels_jvp(*band.inputs, wrt, tangents, x, y, _edge(edges.edge)).numpy()[: len(edges.x)]
                deposit(image, edges.pixel, *(edges.change * (channel * slope) for channel in edges.jump))
        return pixels

    def adjoint(self, wrt: dict, image: Array, terms: str) -> dict:
        """The derivatives of dot(image, pixels) by the parameters `wrt`."""
        band = self.band
        calls: list[Callable[[], dict]] = []
        # All inputs come first: making one waits for the kernels before it
        if terms != "boundary":
            seen, unseen = self.seen(wrt)
            calls += [partial(wavefront.image_vjp, *first, image, weights) for first, weights in self.regular(seen, unseen)]
            for extra, inputs in self.extras(seen):
                pixel, weight, x, y = band.lanes(_unsigned(extra.pixel), extra.weight, extra.x, extra.y)
                calls.append(partial(probe.samples_vjp, *inputs, seen, image, pixel, weight, x, y))
        if terms != "interior":
            for edges in self.edges:
                changed = ad.Array2u(*band.lanes(*_unsigned(edges.pixel)))
                change = type(band.inner.size)(*band.lanes(*edges.change))
                place = band.lanes(edges.x, edges.y)
                moving = changed, change, band.color(edges.jump), *place, _edge(edges.edge)
                calls.append(partial(probe.levels_vjp, *band.inputs, wrt, image, *moving))
        parts = [call() for call in calls]
        zero = {name: dr.zeros(type(value)) for name, value in wrt.items()}
        return {name: sum((part[name] for part in parts if name in part), start=zero[name]) for name in wrt}


@dataclass(frozen=True)
class Found:
    """What the search for a band's edges found, as far as derivatives need it."""

    band: Band
    busy: np.ndarray  # the pixels that are sampled anew, in order
    fine: list[Samples]
    crossed: list[tuple[Pairs, Crossings, dict[str, np.ndarray]]]  # by chunks of pairs, with the fields of their edges

    @cached_property
    def correction(self) -> Correction:
        """Made for the first derivative, while kernels of what comes after the image may be running."""
        band, result = self.band, Correction(self.band)
        # What edges take away from samples, all of which are numbered
        shape = (band.rows + 2) * band.side, (band.resolution[0] + 2) * band.side
        first = shape[0] * shape[1]
        taken = np.zeros(first + sum(group.pixel.size for group in self.fine), number(band.real))
        ends = [np.zeros((2, 0), int), *(pairs.ends(found.pair[found.singular]) for pairs, found, _ in self.crossed)]
        marked = np.concatenate(ends, 1)
        for pairs, found, edge in self.crossed:
            lines, pair, part = stretches(found, pairs, marked)
            deposit(taken, pairs.sample.take(pair, 1), part)
            # Between edges close to each other, seen in curved mirrors, derivatives may change much, and so at creases that are
            # singular, from which a surface runs off into the distance
            most, close = min(band.side, PIECES), np.bincount(found.pair) > 1
            close[found.pair[edge["kind"] == CREASE]] = True
            pieces = np.where(close.take(pair), most, 1)
            for count in {1, most}:
                which = np.flatnonzero(pieces == count)
                pixel, order = (column.take(pair.take(which), 1) for column in (pairs.pixel, pairs.order))
                result.extra.append(beside(take(lines, which), count, pixel, order))
            here = take(pairs, found.pair)
            x = here.x + np.where(here.vertical, 0, found.along)
            y = here.y + np.where(here.vertical, found.along, 0)
            result.edges.append(Moving(x, y, here.pixel, found.change * (here.pixel >= 0), found.jump, edge))
        for group in self.fine:
            weight = (1 - taken[group.first : group.first + group.pixel.size]) / group.side**2
            inside = np.flatnonzero((group.pixel >= 0) & (weight != 0))
            order = walk_order(group.labels.ravel())
            whole = Extra(group.x, group.y, group.pixel, weight, np.zeros(len(weight), bool), order)
            result.extra.append(take(whole, inside))
        result.weights = self._weights(taken[:first].reshape(shape))
        return result

    def _weights(self, taken: np.ndarray) -> Array:
        """What the band's regular samples, of which edges take something away, count for, row by row of samples."""
        side, columns = self.band.side, self.band.resolution[0]
        inner = taken[side:-side, side:-side]
        weights: Array = dr.empty(self.band.real, inner.size)
        regular = weights.numpy().reshape(inner.shape)
        np.subtract(1, inner, out=regular)
        regular.reshape(self.band.rows, side, columns, side)[self.busy // columns, :, self.busy % columns] = 0
        return weights


def _unsigned(pixel: np.ndarray) -> np.ndarray:
    """Pixels as kernels take them: -1 becomes `probe.NOWHERE`."""
    return pixel.astype(np.uint32)


def _edge(numbers: dict[str, np.ndarray]) -> Edge:
    """The Dr.Jit arrays of `numbers_of`."""
    path, event = ({name: lanes(numbers[name]) for name in names} for names in PARTS)
    return Edge(Path(**path), Event(**event))


def numbers_of(edge: Edge, which: np.ndarray) -> dict[str, np.ndarray]:
    """Some of the edges, whose arrays are NumPy's, by the fields of their paths and events."""
    return {name: value[which] for part in (edge.path, edge.event) for name, value in vars(part).items()}
