"""What a fit found, and how it shows itself."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..rendering.notebook import picture
from ..scene.scene import Scene
from .convergence import Iteration, plot
from .loss import split
from .quality import Quality

# Numbers that a result shows, at most
LINES = 16


@dataclass(repr=False)
class FitResult:
    """What a fit found."""

    scene: Scene  #: the first view's, with the recovered parameters
    parameters: dict[str, Any]  #: name to a number, to three, or to those of all spheres of a cloud
    #: one standard deviation of each, in the same form; infinite where the pictures do not tell
    uncertainty: dict[str, Any]
    covariance: np.ndarray  #: of all numbers, in the order of `labels`
    labels: list[str]  #: of the numbers, such as "spheres.ball.center.x"
    loss: float  #: half the mean square of the residuals, at the full resolution
    quality: Quality  #: whether the pictures explain the targets
    gains: np.ndarray  #: of each channel of each view, of shape (views, 3)
    #: the start at each resolution and of each try, and each iteration, with numbers and loss
    history: list[Iteration]
    stopped: str  #: why the fit has ended, in words; "interrupted" after Ctrl-C
    notes: list[str] = field(default_factory=list)  #: what is noteworthy, in words

    @property
    def iterations(self) -> int:
        """The number of steps that were taken, at all resolutions and from all starts."""
        return self.history[-1].iteration

    def named(self, x: np.ndarray) -> dict[str, Any]:
        """The parameters at an iteration's numbers, for `Scene.replace`."""
        return split(self.parameters, x)

    def numbers(self) -> list[tuple[str, float, float]]:
        """The label, the value and one standard deviation of each number."""
        values = np.concatenate([np.ravel(value) for value in self.parameters.values()]).tolist()
        deviations = np.sqrt(self.covariance.diagonal()).tolist()
        return list(zip(self.labels, values, deviations, strict=True))

    def summary(self) -> str:
        """How the fit ended, in one line."""
        steps = f"{self.iterations} iteration{'s' if self.iterations != 1 else ''}"
        sizes = len({step.resolution for step in self.history})
        steps += f" at {sizes} resolutions" if sizes > 1 else ""
        return f"{self.stopped}, after {steps}; loss {self.loss:.4g}"

    def __repr__(self) -> str:
        lines = [f"{label:32} {value:.7g} +- {sd:.2g}" for label, value, sd in self.numbers()]
        return "\n".join([f"FitResult: {self.summary()}", str(self.quality), *_first(lines)])

    def _repr_html_(self) -> str:
        """The numbers and a picture of the recovered scene, for notebooks."""
        from base64 import b64encode
        from html import escape

        rows = [
            f"<tr><td>{escape(label)}</td><td>{value:.7g}</td><td>{sd:.2g}</td></tr>"
            for label, value, sd in self.numbers()
        ]
        encoded = b64encode(picture(self.scene)).decode()
        return (
            f"<p>FitResult: {escape(self.summary())}<br>{escape(str(self.quality))}</p>"
            "<table><tr><th>parameter</th><th>value</th>"
            f"<th>standard deviation</th></tr>{''.join(_first(rows))}</table>"
            f'<img alt="the recovered scene" src="data:image/png;base64,{encoded}">'
        )

    def plot(self, path: str | None = None) -> Any:
        """Draw the loss and each parameter over the iterations; needs the extra `fit`.

        Args:
            path: a file to write, by its ending.

        Returns:
            The matplotlib figure.
        """
        return plot(self.history, self.labels, path)


def _first(lines: list[str]) -> list[str]:
    """The first lines of a table, and that there are more."""
    more = len(lines) - LINES
    return lines if more <= 0 else [*lines[:LINES], f"and {more} more"]
