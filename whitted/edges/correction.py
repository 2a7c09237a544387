"""What edges add to a band's pixels, kept for the derivatives of those: in forward and in reverse
mode.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial

import drjit as dr
import numpy as np
from drjit.llvm import ad

from ..core.arrays import Array
from ..core.host import chunks, stacked, to_array, to_lanes, to_numpy
from ..sampling import kernels as film_kernels
from ..sampling import points
from ..sampling.band import Band, Inputs
from ..sampling.film import Film
from ..scene.structure import Structure
from ..tracing.node import Limits
from . import kernels, settings
from .events import Event, Kind
from .grid import Samples
from .motion import Edge
from .pairs import Crossings, Pairs, walk_order
from .paths import Path
from .quadrature import Extra, intervals_beside, samples_beside
from .tables import concatenated, deposit, rows_of

TERMS = ("both", "interior", "boundary")
# Edges by the fields of their paths and events
Numbers = dict[str, np.ndarray]
Parameters = dict[str, Array]
FilmInputs = tuple[Structure, Parameters, Film, Limits, Parameters]
# Fields of materials that weigh rays
WEIGHTS = (".reflection", ".refraction")


@dataclass(frozen=True)
class MovingPoints:
    """Points on edges, each with what it changes in two pixels when the level function there grows."""

    x: np.ndarray
    y: np.ndarray
    pixel: np.ndarray  # (2, N)
    change: np.ndarray  # (2, N), in units of the jump
    jump: np.ndarray  # (3, N)
    edge: Numbers


@dataclass
class Correction:
    """What makes a band's pixels those of its regular samples and edges, and not of the samples
    alone.
    """

    band: Band
    weights: Array | None = (
        None  # what the band's regular samples still count for, row by row of samples
    )
    extra: list[Extra] = field(default_factory=list)
    edges: list[MovingPoints] = field(default_factory=list)

    def by_weight(self, wrt: Parameters) -> tuple[Parameters, Parameters]:
        """The parameters `wrt`, and apart those weights so small that edges in what they show are
        not found.
        """
        least = settings.LEAST_WEIGHT / self.band.side**2
        small = {
            name
            for name, value in wrt.items()
            if name.endswith(WEIGHTS) and abs(value.numpy()[0]) < least
        }
        return (
            {name: value for name, value in wrt.items() if name not in small},
            {name: wrt[name] for name in wrt if name in small},
        )

    def regular(self, wrt: Parameters) -> Iterator[tuple[FilmInputs, Array | None]]:
        """For each call of a film's kernel: what it takes first, and what each sample counts for.

        Derivatives by small weights have four samples for each of the others'.
        """
        band, (found, small) = self.band, self.by_weight(wrt)
        for film, names, weights in ((band.inner, found, self.weights), (band.finer, small, None)):
            if names:
                yield (band.structure, band.parameters, film, band.limits, names), weights

    def extras(self, wrt: Parameters) -> Iterator[tuple[Extra, Inputs, Parameters]]:
        """The extra samples, no more at once than a kernel takes, with its inputs and parameters."""
        found, _ = self.by_weight(wrt)
        if not self.extra or not found:
            return
        whole = concatenated(self.extra)
        order = np.argsort(whole.order, kind="stable")
        # Derivatives by a weight need rays that have little of it
        dim = not any(name.endswith(WEIGHTS) for name in found)
        for part in chunks(len(order), settings.LANES):
            extra = rows_of(whole, order[part])
            yield extra, self._without_dim_rays(extra.beside & dim), found

    def _without_dim_rays(self, which: np.ndarray) -> Inputs:
        """A kernel's inputs, for samples of which some, that count for a part of a pixel, have no
        rays of little weight.
        """
        *inputs, limits = self.band.inputs
        (least,) = limits.importance.numpy() if limits.importance is not None else (0.0,)
        importance = np.where(
            which, max(least, settings.LEAST_WEIGHT_BESIDE / self.band.side**2), least
        )
        return *inputs, replace(limits, importance=self.band.lanes(importance)[0])  # type: ignore[return-value]

    def tangent(self, wrt: Parameters, tangents: Parameters, terms: str) -> Array:
        """The pixels' derivative along the tangents of the parameters `wrt`."""
        band = self.band
        pixels = to_array(np.zeros(1, band.dtype), band.rows * band.resolution[0] * 3)
        image = pixels.numpy()
        if terms != "boundary":
            for first, weights in self.regular(wrt):
                slopes = {name: tangents[name] for name in first[-1]}
                image += film_kernels.image_jvp(*first, slopes, weights).numpy()
            for extra, inputs, found in self.extras(wrt):
                slopes, place = (
                    {name: tangents[name] for name in found},
                    band.lanes(extra.x, extra.y),
                )
                slope = to_numpy(points.samples_jvp(*inputs, found, slopes, *place))
                deposit(image, extra.pixel, *(stacked(slope, slice(len(extra.x))) * extra.weight))
        if terms != "interior":
            for edges in self.edges:
                place, edge = band.lanes(edges.x, edges.y), _edge(edges.edge)
                slope = kernels.levels_jvp(*band.inputs, wrt, tangents, *place, edge).numpy()[
                    : len(edges.x)
                ]
                deposit(
                    image,
                    edges.pixel,
                    *(edges.change * (channel * slope) for channel in edges.jump),
                )
        return pixels

    def adjoint(self, wrt: Parameters, image: Array, terms: str) -> Parameters:
        """The derivatives of dot(image, pixels) by the parameters `wrt`."""
        calls: list[Callable[[], Parameters]] = []
        # All inputs come first: making one waits for the kernels before it
        if terms != "boundary":
            calls += self._interior_adjoints(wrt, image)
        if terms != "interior":
            calls += self._boundary_adjoints(wrt, image)
        parts = [call() for call in calls]
        zero = {name: dr.zeros(type(value)) for name, value in wrt.items()}
        return {
            name: sum((part[name] for part in parts if name in part), start=zero[name])
            for name in wrt
        }

    def _interior_adjoints(
        self, wrt: Parameters, image: Array
    ) -> Iterator[Callable[[], Parameters]]:
        for first, weights in self.regular(wrt):
            yield partial(film_kernels.image_vjp, *first, image, weights)
        for extra, inputs, found in self.extras(wrt):
            lanes = self.band.lanes(_unsigned(extra.pixel), extra.weight, extra.x, extra.y)
            yield partial(points.samples_vjp, *inputs, found, image, *lanes)

    def _boundary_adjoints(
        self, wrt: Parameters, image: Array
    ) -> Iterator[Callable[[], Parameters]]:
        band = self.band
        for edges in self.edges:
            changed = ad.Array2u(*band.lanes(*_unsigned(edges.pixel)))
            change = band.structure.precision.vector2(*band.lanes(*edges.change))
            place = band.lanes(edges.x, edges.y)
            points_on_edges = changed, change, band.color(edges.jump), *place, _edge(edges.edge)
            yield partial(kernels.levels_vjp, *band.inputs, wrt, image, *points_on_edges)


@dataclass(frozen=True)
class Found:
    """What the search for a band's edges found, as far as derivatives need it."""

    band: Band
    refined: np.ndarray  # the pixels that are sampled anew, in order
    fine: list[Samples]
    crossed: list[
        tuple[Pairs, Crossings, Numbers]
    ]  # by chunks of pairs, with the fields of their edges

    @cached_property
    def correction(self) -> Correction:
        """Made for the first derivative, while kernels of what comes after the image may be
        running.
        """
        band, result = self.band, Correction(self.band)
        # What edges take away from samples, all of which are numbered
        shape = (band.rows + 2) * band.side, (band.resolution[0] + 2) * band.side
        first = shape[0] * shape[1]
        taken = np.zeros(first + sum(group.pixel.size for group in self.fine), band.dtype)
        ends = [np.zeros((2, 0), int)]
        ends += [pairs.ends(found.pair[found.singular]) for pairs, found, _ in self.crossed]
        marked = np.concatenate(ends, 1)
        for pairs, found, edge in self.crossed:
            result.extra += self._beside(pairs, found, edge, marked, taken)
            here = rows_of(pairs, found.pair)
            x = here.x + np.where(here.vertical, 0, found.along)
            y = here.y + np.where(here.vertical, found.along, 0)
            change = found.change * (here.pixel >= 0)
            result.edges.append(MovingPoints(x, y, here.pixel, change, found.jump, edge))
        for group in self.fine:
            weight = (1 - taken[group.first : group.first + group.pixel.size]) / group.side**2
            inside = np.flatnonzero((group.pixel >= 0) & (weight != 0))
            order = walk_order(group.labels.ravel())
            not_beside = np.zeros(len(weight), bool)
            whole = Extra(group.x, group.y, group.pixel, weight, not_beside, order)
            result.extra.append(rows_of(whole, inside))
        result.weights = self._weights(taken[:first].reshape(shape))
        return result

    def _beside(
        self, pairs: Pairs, found: Crossings, edge: Numbers, marked: np.ndarray, taken: np.ndarray
    ) -> list[Extra]:
        """The samples beside edges; what they take away from other samples is added to `taken`."""
        lines, pair, part = intervals_beside(found, pairs, marked)
        deposit(taken, pairs.sample.take(pair, 1), part)
        # Derivatives may change much between edges close to each other, as seen in curved mirrors;
        # and at creases that are singular, from which a surface runs off into the distance
        most, close = min(self.band.side, settings.PIECES), np.bincount(found.pair) > 1
        close[found.pair[edge["kind"] == Kind.CREASE]] = True
        pieces = np.where(close.take(pair), most, 1)
        extra = []
        for count in {1, most}:
            which = np.flatnonzero(pieces == count)
            pixel, order = (
                column.take(pair.take(which), 1) for column in (pairs.pixel, pairs.order)
            )
            extra.append(samples_beside(rows_of(lines, which), count, pixel, order))
        return extra

    def _weights(self, taken: np.ndarray) -> Array:
        """What the band's regular samples, of which edges take something away, count for, row by
        row of samples.
        """
        side, columns = self.band.side, self.band.resolution[0]
        inner = taken[side:-side, side:-side]
        weights: Array = dr.empty(self.band.structure.precision.real, inner.size)
        regular = weights.numpy().reshape(inner.shape)
        np.subtract(1, inner, out=regular)
        rows, columns_of = self.refined // columns, self.refined % columns
        regular.reshape(self.band.rows, side, columns, side)[rows, :, columns_of] = 0
        return weights


def _unsigned(pixel: np.ndarray) -> np.ndarray:
    """Pixels as kernels take them: -1 becomes `points.NOWHERE`."""
    return pixel.astype(np.uint32)


def numbers_of(edge: Edge, which: np.ndarray) -> Numbers:
    """Some of the edges, whose arrays are NumPy's, by the fields of their paths and events."""
    return {
        name: value[which] for part in (edge.path, edge.event) for name, value in vars(part).items()
    }


def _edge(numbers: Numbers) -> Edge:
    """The Dr.Jit arrays of `numbers_of`."""
    path, event = (
        kind(**{part.name: to_lanes(numbers[part.name]) for part in fields(kind)})
        for kind in (Path, Event)
    )
    return Edge(path, event)
