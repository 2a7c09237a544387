"""Pictures in diverging colours: size, colours, scale, and the text below the picture."""

import numpy as np
import pytest
from drjit.llvm import ad
from PIL import Image, ImageDraw

from whitted.files.false_color import BAR, GREY, LINE, MARGIN, NEGATIVE, POSITIVE, write_diverging


@pytest.fixture
def ramp():
    """An image of 401 columns whose mean over the channels runs from -2 to 2."""
    values = np.broadcast_to(np.linspace(-2, 2, 401), (4, 401))
    return np.stack([values - 1, values + 3, values - 2], axis=-1)


@pytest.fixture
def printed(monkeypatch):
    """Each text that is drawn, with its bounding box."""
    texts, draw = {}, ImageDraw.ImageDraw.text

    def text(self, position, text, **options):
        texts[text] = self.textbbox(position, text, font=options["font"])
        draw(self, position, text, **options)

    monkeypatch.setattr(ImageDraw.ImageDraw, "text", text)
    return texts


def read(path):
    with Image.open(path) as file:
        return np.asarray(file).astype(int)


def test_colors_of_a_ramp(tmp_path, ramp):
    scale, clipped = write_diverging(tmp_path / "a.png", ad.TensorXf64(ramp), "title")
    # Steps are 0.01, and each absolute value but 0 occurs twice: the 99.5th percentile of 401 is
    # 1 to 2 steps below 2, and at most 3 of 401 pixels lie beyond it
    assert scale == pytest.approx(1.98, abs=0.021)
    assert clipped == pytest.approx(0.005, abs=0.004)
    picture = read(tmp_path / "a.png")
    assert picture.shape == (4 + 2 * MARGIN + 3 * LINE + BAR, 401, 3)
    rows = picture[:4]
    assert (rows == rows[0]).all()
    assert (rows[0, 200] == 255).all()
    assert (rows[0, 0] == NEGATIVE).all()
    assert (rows[0, -1] == POSITIVE).all()
    # The colour is linear in the value
    assert rows[0, 101] == pytest.approx(255 - (255 - NEGATIVE) * 0.99 / scale, abs=0.51)
    assert rows[0, 299] == pytest.approx(255 - (255 - POSITIVE) * 0.99 / scale, abs=0.51)


def test_bar_has_the_colors_of_the_scale(tmp_path, ramp):
    write_diverging(tmp_path / "a.png", ramp, "title")
    picture = read(tmp_path / "a.png")
    top = 4 + MARGIN + LINE
    bar = picture[top : top + BAR, MARGIN:-MARGIN]
    assert (bar == bar[0]).all()
    assert (bar[0, [0, bar.shape[1] // 2, -1]] == [NEGATIVE, [255] * 3, POSITIVE]).all()
    for row, column in (
        (top - 1, MARGIN),
        (top + BAR, MARGIN + 40),
        (top, MARGIN - 1),
        (top, -MARGIN),
    ):
        assert (picture[row, column] == GREY).all()


@pytest.mark.parametrize(
    "title", ["d image / d camera.fov", "d image / d " + "long_" * 60 + ".radius"]
)
def test_text_is_inside_and_does_not_overlap(tmp_path, printed, title):
    image = np.zeros((10, 24, 3))
    image[3, 4:8], image[5, 6] = 0.5, -9.0
    scale, clipped = write_diverging(tmp_path / "a.png", image, title)
    assert clipped == pytest.approx(1 / 240)
    numbers = [f"{-scale:.3g}", "0", f"+{scale:.3g}"]
    assert list(printed) == [title, "0.42% of the pixels clipped", *numbers]
    height, width, _ = read(tmp_path / "a.png").shape
    boxes = np.array(list(printed.values()))
    assert boxes[:, :2].min() >= 0
    assert boxes[:, 1].min() >= 10
    assert boxes[:, 2].max() <= width
    assert boxes[:, 3].max() <= height
    # Left, middle and right do not overlap
    assert boxes[2, 2] < boxes[3, 0] < boxes[3, 2] < boxes[4, 0]
    top, bottom = 10 + MARGIN + LINE, 10 + MARGIN + LINE + BAR
    assert all(box[3] <= top or box[1] >= bottom for box in boxes)


def test_narrow_image_is_centred_on_grey(tmp_path):
    write_diverging(tmp_path / "a.png", np.zeros((5, 8, 3)), "title")
    rows = read(tmp_path / "a.png")[:5]
    left = (rows.shape[1] - 8) // 2
    assert (rows[:, left : left + 8] == 255).all()
    assert (np.delete(rows, np.s_[left : left + 8], axis=1) == GREY).all()


def test_image_without_scale(tmp_path, printed):
    assert write_diverging(tmp_path / "a.png", np.zeros((5, 8, 3)), "title") == (0, 0)
    assert [text for text in printed if text] == ["title", "0"]


def test_rare_values_are_seen(tmp_path):
    """Where 99.5 % of the pixels are 0, the largest value is the scale."""
    image = np.zeros((20, 20, 3))
    image[7, 9] = -3
    assert write_diverging(tmp_path / "a.png", image, "title") == (3, 0)
    picture = read(tmp_path / "a.png")
    left = (picture.shape[1] - 20) // 2
    assert (picture[7, left + 9] == NEGATIVE).all()
    assert (picture[7, left + 8] == 255).all()


def test_nan_and_infinity(tmp_path):
    image = np.ones((2, 4, 3), dtype=np.float32)
    image[0, 0], image[0, 1], image[0, 2] = np.nan, np.inf, -np.inf
    image[0, 3] = np.inf, -np.inf, 0
    assert write_diverging(tmp_path / "a.png", image, "title") == (1, 0.5)
    picture = read(tmp_path / "a.png")
    left = (picture.shape[1] - 4) // 2
    assert (picture[0, left : left + 4] == [[0] * 3, POSITIVE, NEGATIVE, [0] * 3]).all()
    assert write_diverging(tmp_path / "a.png", np.full((1, 1, 3), np.nan), "title") == (0, 1)


def test_bad_input_and_failed_writes(tmp_path, monkeypatch):
    with pytest.raises(ValueError, match=r"a\.exr: expected a file name that ends in \.png"):
        write_diverging(tmp_path / "a.exr", np.zeros((2, 2, 3)), "title")
    with pytest.raises(
        ValueError, match=r"a\.png: expected an image of shape \(height, width, 3\), got \(2, 2\)"
    ):
        write_diverging(tmp_path / "a.png", np.zeros((2, 2)), "title")

    def fail(*_, **__):
        raise OSError(28, "No space left on device")

    (tmp_path / "a.png").write_bytes(b"old")
    monkeypatch.setattr(Image.Image, "save", fail)
    with pytest.raises(OSError, match=r"No space left on device.*a\.png"):
        write_diverging(tmp_path / "a.png", np.zeros((2, 2, 3)), "title")
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"old"]
