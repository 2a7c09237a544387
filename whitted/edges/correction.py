"""The derivatives of a band's pixels with their edges, in forward and in reverse mode."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import TypeVar

import drjit as dr
import numpy as np
from drjit.llvm import ad

from ..core.arrays import Array, Parameters
from ..core.host import chunks, stacked, to_array, to_lanes, to_numpy
from ..core.pytree import Apart
from ..sampling import kernels as film_kernels
from ..sampling import points
from ..sampling.band import Band, Inputs
from ..sampling.differentiated import Gradients, Names
from ..sampling.film import Film
from ..scene.structure import Structure
from ..tracing.node import Limits
from ..tracing.record import Record
from . import kernels, settings
from .events import Event
from .motion import Edge
from .paths import Path
from .quadrature import Extra
from .tables import concatenated, deposit, rows_of

TERMS = ("both", "interior", "boundary")
# Edges, as NumPy arrays by the names of the fields of their paths and events
Columns = dict[str, np.ndarray]
FilmInputs = tuple[Structure, Apart, Film, Limits, Names]
Part = TypeVar("Part", Path, Event)
# The numbers of samples in a record, and the record; or nothing
Met = tuple[()] | tuple[Array, Record]
# Tangents of parameters, for each direction
Directions = Sequence[Parameters]
# The first fields of `MovingPoints`
COLUMNS = ("x", "y", "pixel", "change", "jump")
# Fields of materials that weigh rays
WEIGHTS = (".reflection", ".refraction")


@dataclass(frozen=True)
class MovingPoints:
    """Points on edges, and what each changes in two pixels as its level function grows.

    All but `pixel` and `change` may also be Dr.Jit arrays, of whole packets.
    """

    x: np.ndarray
    y: np.ndarray
    pixel: np.ndarray  # (2, N)
    change: np.ndarray  # (2, N), in units of the jump
    jump: np.ndarray  # (3, N)
    edge: Columns
    met: Met = ()  # the samples beside them

    def some(self, which: np.ndarray) -> "MovingPoints":
        """Some of the points, by number."""
        edge = {name: column.take(which) for name, column in self.edge.items()}
        x, y, pixel, change, jump = (getattr(self, name).take(which, -1) for name in COLUMNS)
        return MovingPoints(x, y, pixel, change, jump, edge)


@dataclass(frozen=True)
class Traced:
    """Samples that were traced before."""

    extra: Extra
    number: np.ndarray  # of each among all that were traced with it
    record: Record | None  # what these have met


@dataclass
class Correction:
    """What edges change about a band's samples, and how the edges move."""

    band: Band
    # What the band's regular samples still count for, row by row of samples
    weights: Array | None = None
    extra: list[Extra] = field(default_factory=list)
    traced: list[Traced] = field(default_factory=list)
    edges: list[MovingPoints] = field(default_factory=list)

    def by_weight(self, wrt: Parameters) -> tuple[Names, Names]:
        """The names of the parameters `wrt` in two parts, the second for weights that are very
        small.

        Edges in what such a weight shows are too faint to be found.
        """
        least = settings.LEAST_WEIGHT / self.band.side**2

        def is_small(name: str) -> bool:
            return name.endswith(WEIGHTS) and abs(wrt[name].numpy()[0]) < least

        small = tuple(name for name in wrt if is_small(name))
        return tuple(name for name in wrt if name not in small), small

    def regular(self, wrt: Parameters) -> Iterator[tuple[FilmInputs, Array | None]]:
        """For each call of a film's kernel: its first inputs, and what each sample counts for.

        Derivatives by small weights have four times the samples.
        """
        band, (found, small) = self.band, self.by_weight(wrt)
        for film, names, weights in ((band.inner, found, self.weights), (band.finer, small, None)):
            if names:
                yield (band.structure, band.parameters, film, band.limits, names), weights

    def extras(self, wrt: Parameters) -> Iterator[tuple[Extra, Inputs, Names, Met]]:
        """The extra samples, as many at once as a kernel takes, with its inputs, and the names of
        parameters.
        """
        found, _ = self.by_weight(wrt)
        if not found:
            return
        # Derivatives by a weight need faint rays as well
        all_rays = any(name.endswith(WEIGHTS) for name in found)
        inputs = self.band.inputs if all_rays else self._without_dim_rays()
        known = [one for one in self.traced if one.record is not None and not all_rays]
        extra = self.extra + ([] if known else [one.extra for one in self.traced])
        if extra:
            whole = concatenated(extra)
            order = np.argsort(whole.order, kind="stable")
            for part in chunks(len(order), settings.LANES):
                yield rows_of(whole, order[part]), inputs, found, ()
        for one in known:
            for part in chunks(len(one.number), settings.LANES):
                which = np.arange(part.start, part.stop)
                met = *self.band.lanes(one.number[part]), one.record
                yield rows_of(one.extra, which), inputs, found, met

    def _without_dim_rays(self) -> Inputs:
        """A kernel's inputs for samples that count for a part of a pixel.

        They send no rays of little weight.
        """
        structure, parameters, size, limits = self.band.inputs
        given = limits.importance.numpy()[0] if limits.importance is not None else 0.0
        least = settings.LEAST_WEIGHT_BESIDE / self.band.side**2
        least = max(given, min(least, settings.MOST_WEIGHT_BESIDE))
        importance = dr.opaque(structure.precision.real, least)
        return structure, parameters, size, replace(limits, importance=importance)

    def tangents(self, wrt: Parameters, directions: Directions, terms: str) -> list[Array]:
        """The pixels' derivatives along some tangents of the parameters `wrt`."""
        band = self.band
        zero, length = np.zeros(1, band.dtype), band.rows * band.resolution[0] * 3
        pixels = [to_array(zero, length) for _ in directions]
        images = [own.numpy() for own in pixels]
        if terms != "boundary":
            self._add_interior(images, wrt, directions)
        if terms != "interior":
            self._add_boundary(images, wrt, directions)
        return pixels

    def _add_interior(
        self, images: list[np.ndarray], wrt: Parameters, directions: Directions
    ) -> None:
        for first, weights in self.regular(wrt):
            slopes = film_kernels.image_jvp(*first, _only(first[-1], directions), weights)
            for image, slope in zip(images, slopes, strict=True):
                image += slope.numpy()
        for extra, inputs, found, met in self.extras(wrt):
            place = *self.band.lanes(extra.x, extra.y), *met
            slopes = points.samples_jvp(*inputs, found, _only(found, directions), *place)
            for image, slope in zip(images, slopes, strict=True):
                channels = stacked(to_numpy(slope), slice(len(extra.x)))
                deposit(image, extra.pixel, *(channels * extra.weight))

    def _add_boundary(
        self, images: list[np.ndarray], wrt: Parameters, directions: Directions
    ) -> None:
        for edges in self.edges:
            count = edges.pixel.shape[1]
            place = self.band.lanes(edges.x, edges.y)
            names = tuple(wrt)
            inputs = *self.band.inputs, names, _only(names, directions), *place, _edge(edges.edge)
            inputs += edges.met
            jump = [np.array(channel, copy=False)[:count] for channel in edges.jump]
            for image, slope in zip(images, kernels.levels_jvp(*inputs), strict=True):
                moves = slope.numpy()[:count]
                deposit(image, edges.pixel, *(edges.change * (own * moves) for own in jump))

    def adjoint(self, wrt: Parameters, image: Array, terms: str) -> Parameters:
        """The derivatives of dot(image, pixels) by the parameters `wrt`."""
        calls: list[tuple[Names, Callable[[], Gradients]]] = []
        # All inputs come first: making one waits for the kernels before it
        if terms != "boundary":
            calls += self._interior_adjoints(wrt, image)
        if terms != "interior":
            calls += self._boundary_adjoints(wrt, image)
        sums: dict[Names, Gradients] = {}
        for names, call in calls:
            found = call()
            sums[names] = sums[names].plus(found) if names in sums else found
        total: Parameters = {}
        for names, found in sums.items():
            for name, slope in found.by_name(self.band.structure, names).items():
                total[name] = total[name] + slope if name in total else slope
        return {name: total.get(name, dr.zeros(type(value))) for name, value in wrt.items()}

    def _interior_adjoints(
        self, wrt: Parameters, image: Array
    ) -> Iterator[tuple[Names, Callable[[], Gradients]]]:
        for first, weights in self.regular(wrt):
            yield first[-1], partial(film_kernels.image_vjp, *first, image, weights)
        for extra, inputs, found, met in self.extras(wrt):
            lanes = self.band.lanes(_unsigned(extra.pixel), extra.weight, extra.x, extra.y)
            yield found, partial(points.samples_vjp, *inputs, found, image, *lanes, *met)

    def _boundary_adjoints(
        self, wrt: Parameters, image: Array
    ) -> Iterator[tuple[Names, Callable[[], Gradients]]]:
        band, names = self.band, tuple(wrt)
        for edges in self.edges:
            changed = ad.Array2u(*band.lanes(*_unsigned(edges.pixel)))
            change = band.structure.precision.vector2(*band.lanes(*edges.change))
            place = band.lanes(edges.x, edges.y)
            points_on_edges = changed, change, band.color(edges.jump), *place, _edge(edges.edge)
            inputs = *band.inputs, names, image, *points_on_edges, *edges.met
            yield names, partial(kernels.levels_vjp, *inputs)


def _only(wrt: Names, directions: Directions) -> tuple[Parameters, ...]:
    """The tangents of the parameters of these names alone."""
    return tuple({name: tangents[name] for name in wrt} for tangents in directions)


def _unsigned(pixel: np.ndarray) -> np.ndarray:
    """Pixels as kernels take them: -1 becomes `points.NOWHERE`."""
    return pixel.astype(np.uint32)


def _edge(columns: Columns) -> Edge:
    """Edges as Dr.Jit arrays."""
    return Edge(_part(Path, columns), _part(Event, columns))


def _part(kind: type[Part], columns: Columns) -> Part:
    """An edge's path or event."""
    return kind(**{column.name: _in_lanes(columns[column.name]) for column in fields(kind)})


def _in_lanes(column: np.ndarray | Array) -> Array:
    return to_lanes(column) if isinstance(column, np.ndarray) else column
