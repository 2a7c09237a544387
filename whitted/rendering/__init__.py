"""From a scene to an image, as one differentiable operation."""
