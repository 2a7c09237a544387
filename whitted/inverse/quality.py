"""Whether a fit has found the scene: what is left of the residual, against what explains it.

Two things may be left when the numbers are right: noise, which is independent from pixel to pixel,
and the error of finitely many samples, which has signs that change along an edge. An object in a
wrong place leaves patches of one sign. So sums over blocks of pixels are compared with what sums of
independent errors would be.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .loss import Objective
from .noise import fine_differences, noise_variance
from .residuals import residuals_of

EXPLAINED = "explained"
STRUCTURED = (
    "structured residual: probably a local minimum, or something that the scene does not have"
)
# A block has 2, 4, 8, ... pixels along a side, and a picture at least so many blocks along a side,
# but for the smallest of a small picture
BLOCKS = 8
# Sums of independent errors exceed so many of their standard deviations once in 30,000 pictures
DEVIATIONS = 4.0
# What samples leave in blocks of a real picture, in units of what is expected of them
SAMPLING = 3.0
# The part of samples' errors that adds up in blocks of 2 x 2 pixels; it halves with every doubling
# (measured at 4 and 16 samples in the shipped scenes: 0.02 to 0.16). Less is chance
TOGETHER = 0.1
# How strong samples' errors are thought to be, in units of the variance of plain samples of the
# fit's own number: targets have from a quarter of that number to some twenty times as many
STRENGTHS = 1 / 16, 4.0
# The variance of noise may be so many times larger at some pixels than at most
UNEVEN = 4.0
# A robust loss must not leave out more of the pixels
MOST = 0.25
# Roundings, and the steps that a fit does not take any more, leave this part of the target
LEAST = 1e-5


@dataclass(frozen=True)
class Quality:
    """How far a fit's pictures explain its targets; a string says it in words.

    Radiance stands for the root of a mean square over channels of pixels.
    """

    explained: bool  #: whether noise and samples account for what is left
    verdict: str  #: "explained", or "structured residual: ..."
    noise: float  #: standard deviation of the target's noise, in radiance
    sampling: float  #: error of finitely many samples in what is left, in radiance
    structured: float  #: what neither of them accounts for, in radiance
    left_out: float = 0.0  #: share of the pixels that a robust loss leaves out
    unseen: tuple[str, ...] = ()  #: labels of the numbers on which no picture depends
    weak: tuple[str, ...] = ()  #: directions along which the pictures hardly change

    def __str__(self) -> str:
        left = f"noise {self.noise:.2g}, sampling {self.sampling:.2g}"
        if not self.explained:
            left += f", structure {self.structured:.2g}"
        share = f", but for {self.left_out:.2g} of the pixels" if self.left_out else ""
        words = [f"{self.verdict}{share} ({left})"]
        words += [f"does not depend on {label}" for label in self.unseen]
        words += [f"hardly changes along {direction}" for direction in self.weak]
        return "; ".join(words)


@dataclass(frozen=True)
class Spectrum:
    """Mean squares of a residual: of neighbours' differences, and what adds up in blocks.

    Sums over the views of a fit.
    """

    total: float
    fine: float  # of differences along both axes: the variance of independent errors
    level: float  # the same by the median, which edges do not raise
    together: np.ndarray  # for each size of blocks: the mean square of means, less the independent
    spread: np.ndarray  # the standard deviation of that, if errors are independent


def assess(
    objective: Objective, x: np.ndarray, unseen: Sequence[str] = (), weak: Sequence[str] = ()
) -> Quality:
    """The quality of a fit that ends with these numbers.

    Args:
        unseen: labels of the numbers on which no picture depends.
        weak: directions along which the pictures hardly change.
    """
    residuals = residuals_of(objective, x)
    left, samples = spectrum(residuals.left), spectrum(residuals.samples)
    noise = left.level
    # How strong the samples' errors are in what is left
    strength = float(np.clip((left.fine - noise) / samples.fine, *STRENGTHS)) if samples.fine else 0
    usual = samples.total * TOGETHER / 2.0 ** np.arange(len(samples.together))
    by_samples = SAMPLING * strength * np.maximum(samples.together, usual)
    power = np.mean([np.mean(view.target.astype(float) ** 2) for view in objective.views])
    allowed = by_samples + DEVIATIONS * left.spread + LEAST**2 * power
    structured = max(0.0, float((left.together - allowed).max(initial=0)))
    explained = structured == 0 and residuals.share <= MOST
    return Quality(
        explained=explained,
        verdict=EXPLAINED if explained else STRUCTURED,
        noise=noise**0.5,
        sampling=(strength * samples.total) ** 0.5,
        structured=structured**0.5,
        left_out=residuals.share,
        unseen=tuple(unseen),
        weak=tuple(weak),
    )


def spectrum(pictures: Sequence[np.ndarray]) -> Spectrum:
    """The spectrum of some residuals, each of shape (height, width, 3)."""
    differences = np.concatenate([fine_differences(picture).ravel() for picture in pictures])
    level = noise_variance(*pictures)
    blocks = [_blocks(picture, level) for picture in pictures]
    sizes = min(len(one) for one in blocks)
    sums = np.array([one[:sizes] for one in blocks]).reshape(len(blocks), sizes, 2).sum(0)
    count = sum(picture.size for picture in pictures)
    return Spectrum(
        total=sum(float(np.vdot(picture, picture)) for picture in pictures) / count,
        fine=float(np.vdot(differences, differences)) / max(1, differences.size),
        level=level,
        together=sums[:, 0] / count,
        spread=np.sqrt(sums[:, 1]) / count,
    )


def _blocks(picture: np.ndarray, level: float) -> list[tuple[float, float]]:
    """For each size of blocks: the sum of squared sums less the independent, and its variance.

    Both per pixel of a block. Of errors that are independent the first is 0 on average.
    """
    sums, squares, fourth = picture, picture**2, picture**4
    size, found = 1, []
    least = max(2, min(2 * BLOCKS, *picture.shape[:2]))
    while min(sums.shape[:2]) >= least:
        sums, squares, fourth = _in_fours(sums), _in_fours(squares), _in_fours(fourth)
        size *= 4
        most = UNEVEN * size * level
        # One block with much structure must not hide itself
        pairs = np.where(squares <= most, squares**2 - fourth, most**2 * (1 - 1 / size))
        found.append((float((sums**2 - squares).sum()) / size, 2 * float(pairs.sum()) / size**2))
    return found


def _in_fours(picture: np.ndarray) -> np.ndarray:
    """Sums over 2 x 2 pixels."""
    height, width = (n // 2 * 2 for n in picture.shape[:2])
    return picture[:height, :width].reshape(height // 2, 2, width // 2, 2, -1).sum((1, 3))
