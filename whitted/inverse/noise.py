"""How strong the noise of a picture is."""

import numpy as np

# The median of the modulus of a normal number
MEDIAN = 0.6745


def fine_differences(picture: np.ndarray) -> np.ndarray:
    """Differences along both axes, of four pixels each; of noise they have its deviation.

    Args:
        picture: shape (height, width, 3); a last row or column that stands alone is left out.
    """
    height, width = (n // 2 * 2 for n in picture.shape[:2])
    a, b = picture[:height:2, :width:2], picture[:height:2, 1:width:2]
    c, d = picture[1:height:2, :width:2], picture[1:height:2, 1:width:2]
    return (a - b - c + d) / 2


def noise_variance(*pictures: np.ndarray) -> float:
    """The variance of noise that is independent from pixel to pixel.

    It is read from the median of differences, which edges do not raise as long as they are few.
    """
    differences = np.concatenate([fine_differences(picture).ravel() for picture in pictures])
    if not differences.size:
        return 0.0
    return float((np.median(np.abs(differences)) / MEDIAN) ** 2)
