"""The file of a latency model: what it may hold, and what is said of one that is damaged."""

import io
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.robots.latency_model.weights import MAX_COPIES, ModelWeights, read_copies, write_copies
from common.errors import InputError
from common.pinned_file import MAX_BYTES, pin
from tests.actors.robots.latency_model.models import Arrays, drawn, saved, together


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, ">f4"])
def test_arrays_come_back_as_float64(tmp_path: Path, dtype: str) -> None:
    arrays = {name: array.astype(dtype) for name, array in drawn(3, 1).items()}
    arrays["fc_weight"] = np.asfortranarray(arrays["fc_weight"])
    (found,) = read_copies(saved(tmp_path / "m.npz", arrays))
    for name, array in arrays.items():
        assert getattr(found, name).dtype == np.float64
        assert (getattr(found, name) == array).all()


def test_a_compressed_file_will_do(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "m.npz", **drawn(3, 1))  # type: ignore[arg-type]
    (found,) = read_copies(str(tmp_path / "m.npz"))
    assert found.fc_bias.shape == (3,)


@pytest.mark.parametrize("number", [1, 3, MAX_COPIES])
def test_copies_come_back_in_their_order(tmp_path: Path, number: int) -> None:
    drawn_ones = [drawn(2, seed) for seed in range(number)]
    found = read_copies(saved(tmp_path / "m.npz", together(*drawn_ones)))
    for copy, arrays in zip(found, drawn_ones, strict=True):
        assert all((getattr(copy, name) == array).all() for name, array in arrays.items())
    write_copies(tmp_path / "again.npz", found)
    again = read_copies(str(tmp_path / "again.npz"))
    for copy, before in zip(again, found, strict=True):
        assert all((getattr(copy, name) == array).all() for name, array in vars(before).items())


def test_a_single_copy_is_written_in_the_published_format(tmp_path: Path) -> None:
    arrays = drawn(3, 1)
    write_copies(tmp_path / "m.npz", [ModelWeights(**arrays)])  # type: ignore[arg-type]
    with np.load(tmp_path / "m.npz") as written:
        assert {name: (written[name].shape, written[name].dtype) for name in written} == {
            name: (array.shape, np.float32) for name, array in arrays.items()
        }


def test_a_file_that_is_not_the_runs_is_refused(tmp_path: Path) -> None:
    name = pin(saved(tmp_path / "m.npz", drawn(3, 1)))
    assert len(read_copies(name)) == 1
    saved(tmp_path / "m.npz", drawn(3, 2))
    with pytest.raises(InputError, match="is not the run's"):
        read_copies(name)


def test_an_archive_of_many_members_or_odd_names_is_told_in_a_few_words(tmp_path: Path) -> None:
    for names in ([f"{number}.npy" for number in range(5_000)], ["a\x1b[31m\nline.npy"]):
        with zipfile.ZipFile(tmp_path / "m.npz", "w") as archive:
            for name in names:
                archive.writestr(name, b"")
        with pytest.raises(InputError, match=r"m\.npz holds no latency model") as error:
            read_copies(str(tmp_path / "m.npz"))
        assert len(f"{error.value}") < 400
        assert f"{error.value}".isprintable()


def changed(**arrays: object) -> Arrays:
    return {**drawn(3, 1), **arrays}  # type: ignore[dict-item]


WRONG: list[tuple[Arrays, str]] = [
    (
        changed(fc_weight=np.zeros((3, 540), np.float32)),
        r"fc_weight has shape \[3, 540\] where .*1080",
    ),
    (changed(fc_weight=np.zeros((2, 1080), np.float32)), r"fc_weight has shape \[2, 1080\] where"),
    (changed(fc_bias=np.zeros((3, 1), np.float32)), r"fc_bias has shape \[3, 1\] where"),
    (changed(fc_bias=np.zeros(0, np.float32)), r"fc_bias has shape \[0\] where"),
    (changed(fc_bias=np.zeros(4097, np.float32)), r"fc_bias has shape \[4097\] .*1 to 4,096"),
    (changed(pred_weight=np.zeros((17, 3), np.float32)), r"pred_weight has shape \[17, 3\] where"),
    (changed(pred_bias=np.zeros(6, np.float32)), r"pred_bias has shape \[6\] where .*\[18\]"),
    (changed(pred_bias=np.zeros(18, np.int64)), "pred_bias has type int64 where floats are"),
    (changed(pred_bias=np.zeros(18, np.complex64)), "pred_bias has type complex64"),
    (changed(pred_bias=np.full(18, np.nan)), "pred_bias holds a number that is not within"),
    (changed(fc_weight=np.full((3, 1080), np.inf)), r"fc_weight holds a .* not within ±1e\+09"),
    (changed(fc_bias=np.full(3, -1.1e9)), "fc_bias holds a number that is not within"),
    (changed(pred_bias=np.array([{}] * 18, object)), "allow_pickle"),
    ({"fc_weight": drawn(3, 1)["fc_weight"]}, "its members are 'fc_weight.npy'"),
    (changed(rate=np.zeros(1)), "its members are .*'rate.npy'"),
    (
        {**together(drawn(3, 1), drawn(3, 2)), "pred_bias": np.zeros((3, 18), np.float32)},
        "its arrays are of 2, 3 copies where the same number is expected, from 1 to 16",
    ),
    (together(*[drawn(1, 1)] * 17), "of 17 copies where"),
    ({name: each[:0] for name, each in together(drawn(1, 1)).items()}, "of 0 copies where"),
    (
        {**together(drawn(3, 1)), "pred_bias": np.array(1, np.float32)},
        "its arrays are of 0, 1 copies where",
    ),
    (
        {**together(drawn(3, 1)), "pred_bias": np.zeros((1, 6), np.float32)},
        r"pred_bias has shape \[6\] where .*\[18\]",
    ),
    (together(together(drawn(3, 1))), r"fc_bias has shape \[1, 3\] where"),
    (
        together(drawn(3, 1), changed(fc_bias=np.full(3, np.nan))),
        "fc_bias holds a number that is not within",
    ),
]


@pytest.mark.parametrize(("arrays", "words"), WRONG, ids=[words for _, words in WRONG])
def test_arrays_that_are_no_latency_model(tmp_path: Path, arrays: Arrays, words: str) -> None:
    name = saved(tmp_path / "m.npz", arrays)
    with pytest.raises(InputError, match=words) as error:
        read_copies(name)
    assert str(error.value).startswith(f"{name} holds no latency model (")
    assert "name an .npz file of Physical Atari's format" in str(error.value)


def test_a_small_file_that_unpacks_to_a_large_one(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "m.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("fc_weight", "fc_bias", "pred_weight", "pred_bias"):
            archive.writestr(f"{name}.npy", bytes(2**25))
    assert (tmp_path / "m.npz").stat().st_size < 2**20
    with pytest.raises(InputError, match="unpacked it is larger than 67,108,864 bytes"):
        read_copies(str(tmp_path / "m.npz"))


def test_a_header_that_promises_more_than_there_is(tmp_path: Path) -> None:
    """Its array would take 8 EB."""
    with zipfile.ZipFile(tmp_path / "m.npz", "w") as archive:
        for name, array in drawn(3, 1).items():
            member = io.BytesIO()
            shape = (2**60,) if name == "pred_bias" else array.shape
            described = {"descr": "<f4", "fortran_order": False, "shape": shape}
            np.lib.format.write_array_header_1_0(member, described)
            archive.writestr(f"{name}.npy", member.getvalue() + array.tobytes())
    with pytest.raises(InputError, match="holds no latency model"):
        read_copies(str(tmp_path / "m.npz"))


_WHOLE = io.BytesIO()
np.savez(_WHOLE, **drawn(1, 1))  # type: ignore[arg-type]


@given(
    cut=st.integers(0, len(_WHOLE.getvalue())),
    damage=st.lists(
        st.tuples(st.integers(0, len(_WHOLE.getvalue()) - 1), st.integers(0, 255)), max_size=8
    ),
)
def test_a_damaged_file_is_a_model_or_is_refused(
    tmp_path_factory: pytest.TempPathFactory, cut: int, damage: list[tuple[int, int]]
) -> None:
    content = bytearray(_WHOLE.getvalue())
    for place, value in damage:
        content[place] = value
    path = tmp_path_factory.getbasetemp() / "damaged.npz"
    path.write_bytes(content[:cut] if not damage else content)
    with suppress(InputError):
        assert all(np.isfinite(each.fc_weight).all() for each in read_copies(str(path)))


def test_what_is_no_archive(tmp_path: Path) -> None:
    for content in (b"", b"\x80\x04K\x01.", b"PK\x03\x04"):
        (tmp_path / "m.npz").write_bytes(content)
        with pytest.raises(InputError, match="holds no latency model"):
            read_copies(str(tmp_path / "m.npz"))
    assert MAX_BYTES == 2**26
