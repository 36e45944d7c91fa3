import hashlib

import pytest

from mvmatch.bench.datasets import CHECKSUMS, verify_checksums
from mvmatch.errors import DataError

EMPTY = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
"""SHA-256 of nothing, as FIPS 180-4's examples give it."""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "a b.png").write_bytes(b"abc")
    (tmp_path / "empty.txt").touch()
    digest = hashlib.sha256(b"abc").hexdigest()
    (tmp_path / CHECKSUMS).write_text(f"{digest}  images/a b.png\n{EMPTY} *./empty.txt\n")
    return tmp_path


def test_files_that_are_as_listed_are_counted(folder):
    (folder / "unlisted").touch()
    assert verify_checksums(folder) == 2


def test_missing_and_changed_files_are_named(folder):
    (folder / "empty.txt").unlink()
    (folder / "images" / "a b.png").write_bytes(b"abd")
    with pytest.raises(DataError, match=r"1 are missing \(empty.txt\) and 1 .*\(images/a b.png\)"):
        verify_checksums(folder)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"\xff\xfe", "cannot be read"),
        (b"abc  images/a.png\n", "line 1: a SHA-256"),
        (f"{EMPTY}  ../empty.txt\n".encode(), "leads out"),
        (f"{EMPTY}  /etc/passwd\n".encode(), "leads out"),
    ],
)
def test_a_list_that_is_none_is_refused(folder, content, message):
    (folder / CHECKSUMS).write_bytes(content)
    with pytest.raises(DataError, match=message):
        verify_checksums(folder)


def test_without_a_list_the_error_says_how_to_make_one(folder):
    (folder / CHECKSUMS).unlink()
    with pytest.raises(DataError, match="sha256sum"):
        verify_checksums(folder)
