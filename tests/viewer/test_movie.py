"""Films that can be read again."""

import contextlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.GifImagePlugin import GifImageFile

from common.errors import InputError
from viewer.movie import open_movie

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


def test_a_film_that_ends_by_an_error_has_what_was_taken(tmp_path: Path) -> None:
    pytest.importorskip("av")
    path = tmp_path / "film.mp4"
    with contextlib.suppress(KeyboardInterrupt), open_movie(path, 15.0) as add:
        add(np.zeros((96, 128, 3), np.uint8))
        raise KeyboardInterrupt
    assert cv2.VideoCapture(str(path)).read()[0]
    with pytest.raises(ValueError, match="nothing was taken"), open_movie(path, 15.0):
        raise ValueError("nothing was taken")


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
        open_movie(tmp_path / "file" / "film.mp4", 15.0)
