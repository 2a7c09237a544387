"""Mirror reflection, refraction and the Fresnel equations: pure functions.

Conventions: `eta` = n_incident / n_transmitted, `cos_theta_i` = -d . n >= 0 with the normal turned
towards the side that the ray came from. Source: M. Born, E. Wolf, Principles of Optics (1999),
section 1.5.
"""

import drjit as dr

from ..core.arrays import Array

# Keeps 0 / 0 at grazing incidence finite, in either precision
TINY = 1e-30


def reflect(d: Array, n: Array) -> Array:
    """Mirror the unit direction d at the unit normal n: d - 2 (d . n) n."""
    return dr.fma(n, -2 * dr.dot(d, n), d)


def transmission(cos_theta_i: Array, eta: Array) -> tuple[Array, Array]:
    """Snell's law.

    Returns:
        cos_theta_t^2 = 1 - eta^2 (1 - cos_theta_i^2), summed so that it is cos_theta_i^2 exactly
        where eta is 1, and whether the reflection is total. That needs eta > 1, which rounding at
        grazing incidence cannot fake.
    """
    squared = dr.fma(eta * cos_theta_i, eta * cos_theta_i, (1 - eta) * (1 + eta))
    return squared, (squared <= 0) & (eta > 1)


def refract(d: Array, n: Array, cos_theta_i: Array, cos_theta_t: Array, eta: Array) -> Array:
    """The refracted unit direction, eta d + (eta cos_theta_i - cos_theta_t) n."""
    return eta * d + dr.fma(eta, cos_theta_i, -cos_theta_t) * n


def fresnel(cos_theta_i: Array, cos_theta_t: Array, eta: Array) -> Array:
    """Reflectance of a smooth dielectric for unpolarised light, in [0, 1]; exactly 0 where eta is
    1.
    """
    s = dr.fma(eta, cos_theta_i, -cos_theta_t) / dr.fmax(
        dr.fma(eta, cos_theta_i, cos_theta_t), TINY
    )
    p = dr.fma(eta, -cos_theta_t, cos_theta_i) / dr.fmax(
        dr.fma(eta, cos_theta_t, cos_theta_i), TINY
    )
    return dr.fma(s, s, p * p) / 2
