"""Films that can be read again."""

import contextlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.GifImagePlugin import GifImageFile

from common.errors import InputError
from viewer.movie import check_movie, open_movie

COLOURS = ((230, 20, 20), (20, 200, 20), (20, 20, 220))


def film(path: Path) -> None:
    with open_movie(path, 15.0) as add:
        for colour in COLOURS:
            add(np.full((96, 128, 3), colour, np.uint8))


def test_an_mp4(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    path = tmp_path / "new folder" / "film.mp4"
    film(path)
    video = cv2.VideoCapture(str(path))
    assert video.get(cv2.CAP_PROP_FPS) == 15
    for colour in COLOURS:
        read, picture = video.read()
        assert read
        assert picture.shape == (96, 128, 3)
        np.testing.assert_allclose(picture.mean(axis=(0, 1))[::-1], colour, atol=12)
    assert not video.read()[0]
    with av.open(str(path)) as made:  # as browsers demand it
        assert made.streams.video[0].codec_context.name == "h264"
        assert made.streams.video[0].codec_context.pix_fmt == "yuv420p"
        # ITU-T H.273: the matrix of BT.601 and its limited range, primaries of BT.709, sRGB.
        told = made.streams.video[0].codec_context
        colours = told.colorspace, told.color_range, told.color_primaries, told.color_trc
        assert colours == (6, 1, 1, 13)
    content = path.read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")


def test_a_name_with_a_colon_is_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    film(Path("file:z/film.mp4"))  # to FFmpeg, "file:" is a protocol
    assert cv2.VideoCapture(str(tmp_path / "file:z" / "film.mp4")).read()[0]


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_an_earlier_film_stays_until_the_new_one_is_whole(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    film(path)
    before = path.read_bytes()
    with contextlib.suppress(OSError), open_movie(path, 15.0) as add:
        for _ in range(100):  # more than an encoder keeps for itself
            add(np.random.default_rng(1).integers(0, 255, (96, 128, 3), np.uint8))
        assert path.read_bytes() == before
        raise OSError("the disk is full")
    assert list(tmp_path.iterdir()) == [path]
    with open_movie(path, 15.0):
        pass  # without a picture there is no film
    assert path.read_bytes() == before
    with open_movie(path, 15.0) as add:
        add(np.zeros((96, 128, 3), np.uint8))
    assert path.read_bytes() != before
    assert list(tmp_path.iterdir()) == [path]


def test_a_gif(tmp_path: Path) -> None:
    path = tmp_path / "film.GIF"
    film(path)
    with Image.open(path) as gif:
        assert isinstance(gif, GifImageFile)
        assert (gif.n_frames, gif.size) == (3, (64, 48))
        assert gif.info["duration"] == 70
        for number, colour in enumerate(COLOURS):
            gif.seek(number)
            picture = np.asarray(gif.convert("RGB"))
            np.testing.assert_allclose(picture[20, 30], colour, atol=6)


def test_other_names_are_refused_and_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "film.txt"
    path.write_text("kept")
    with pytest.raises(InputError, match=r"\.mp4 or \.gif"):
        open_movie(path, 15.0)
    assert path.read_text() == "kept"


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        check_movie(tmp_path / "file" / "film.mp4", 1.0)
