"""Evolution of a cloud of numbers towards a lower loss, without derivatives.

A generation of numbers is drawn from a normal distribution. The better half of them moves its mean,
and shapes its covariance by the steps that have helped. So it follows a curved valley, and passes
over what is rough on a small scale.

Source: N. Hansen, "The CMA Evolution Strategy: A Tutorial" (2016), arXiv:1604.00772; the code is
that of the library `cmaes`.
"""

import math
from collections.abc import Callable

import numpy as np

# A deviation below which steps with derivatives do the rest, in units of the scales
SMALL = 2e-3


def evolve(
    loss: Callable[[np.ndarray], float],
    count: int,
    deviation: float,
    evaluations: int,
    random: np.random.Generator,
    late: Callable[[], bool],
) -> tuple[float, np.ndarray]:
    """The lowest loss of the vectors drawn around 0 until they are close together, and its vector.

    Args:
        loss: of a vector; what is not finite is never the lowest.
        count: length of a vector.
        deviation: of the first generation.
        evaluations: of the loss, at most.
        late: asked after each generation whether to end.
    """
    # Here, since it imports SciPy where there is one, and that takes a second
    from cmaes import CMA

    # The library has no vectors of one number: a second one is drawn, and not used
    cloud = CMA(np.zeros(max(count, 2)), deviation, seed=int(random.integers(1 << 31)))
    lowest, best = math.inf, np.zeros(count)
    for _ in range(evaluations // cloud.population_size):
        drawn = [cloud.ask() for _ in range(cloud.population_size)]
        losses = [_finite(loss(x[:count])) for x in drawn]
        first = int(np.argmin(losses))
        if losses[first] < lowest:
            lowest, best = losses[first], drawn[first][:count]
        cloud.tell(list(zip(drawn, losses, strict=True)))
        if late() or np.std(drawn, 0)[:count].max() < SMALL:
            break
    return lowest, best


def _finite(loss: float) -> float:
    return loss if math.isfinite(loss) else math.inf
