"""Whole files and folders: whatever breaks off, a reader finds the old one or the new one."""

import os
import stat
from pathlib import Path

import pytest

from imodbatch.tables.atomic import replacing, replacing_folder, sweep, write_bytes, write_text


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_gets_its_content_and_the_usual_permissions(tmp_path: Path) -> None:
    old = os.umask(0o027)
    try:
        write_text(tmp_path / "a.txt", "größer\n")
        with replacing_folder(tmp_path / "b") as folder:
            (folder / "c").touch()
    finally:
        os.umask(old)
    assert (tmp_path / "a.txt").read_bytes() == "größer\n".encode()
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o640
    assert stat.S_IMODE((tmp_path / "b").stat().st_mode) == 0o750
    assert names(tmp_path) == ["a.txt", "b"]


def test_until_the_block_ends_a_reader_finds_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"old")
    with replacing(path) as file:
        file.write(b"new")
        (partial,) = tmp_path.glob(".a.*.partial")
        assert path.read_bytes() == b"old"
    assert path.read_bytes() == b"new"
    assert not partial.exists()


def test_two_writers_of_one_file_do_not_meet(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with replacing(path) as first, replacing(path) as second:
        first.write(b"first")
        second.write(b"second, longer")
    assert path.read_bytes() == b"first"  # the outer block ended last
    assert names(tmp_path) == ["a"]


def write_half_a_file(path: Path, error: BaseException) -> None:
    with replacing(path) as file:
        file.write(b"half")
        raise error


def write_half_a_folder(path: Path, error: BaseException) -> None:
    with replacing_folder(path) as folder:
        (folder / "half").touch()
        raise error


@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt()])
def test_what_breaks_off_leaves_the_old_file_alone(tmp_path: Path, error: BaseException) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"old")
    for write in (write_half_a_file, write_half_a_folder):
        with pytest.raises(type(error)):
            write(path, error)
    assert names(tmp_path) == ["a"]
    assert path.read_bytes() == b"old"


def test_the_content_is_on_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    fsync, replace = os.fsync, Path.replace
    monkeypatch.setattr(os, "fsync", lambda fd: (done.append("fsync"), fsync(fd)))
    monkeypatch.setattr(
        Path, "replace", lambda self, to: (done.append("replace"), replace(self, to))[1]
    )
    write_bytes(tmp_path / "a", b"content")
    assert done == ["fsync", "replace"]


def test_a_symbolic_link_is_replaced_and_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "other"
    other.write_bytes(b"precious")
    link = tmp_path / "a"
    link.symlink_to(other)
    write_bytes(link, b"new")
    assert not link.is_symlink()
    monkeypatch.setattr("imodbatch.tables.atomic.secrets.token_hex", lambda _: "01234567")
    planted = tmp_path / ".a.01234567.partial"
    planted.symlink_to(other)
    with pytest.raises(FileExistsError):
        write_bytes(link, b"newer")
    assert planted.is_symlink()  # what is not ours is not removed either
    assert other.read_bytes() == b"precious"
    assert link.read_bytes() == b"new"


def test_a_folder_takes_the_place_of_the_old_one_whole(tmp_path: Path) -> None:
    path = tmp_path / "data[1]"
    path.mkdir()
    (path / "old").touch()
    left, others = tmp_path / ".data[1].01234567.partial", tmp_path / ".data.01234567.partial"
    for folder in (left, others):
        folder.mkdir()
    with replacing_folder(path) as unfinished:
        (unfinished / "new").touch()
        assert names(path) == ["old"]
    assert names(path) == ["new"]
    assert names(tmp_path) == [others.name, path.name]


def test_sweeping_takes_left_overs_and_nothing_else(tmp_path: Path) -> None:
    kept = tmp_path / "sub" / "a.partial"
    left = [tmp_path / ".a.01234567.partial", tmp_path / "sub" / ".b.01234567.partial"]
    elsewhere = tmp_path.with_name(f"{tmp_path.name}-elsewhere")
    elsewhere.mkdir()
    precious = elsewhere / ".c.01234567.partial"
    (left[1] / ".d.01234567.partial").mkdir(parents=True)
    for path in (kept, left[0], precious):
        path.touch()
    (tmp_path / "link").symlink_to(elsewhere)
    (tmp_path / ".e.01234567.partial").symlink_to(elsewhere)
    sweep(tmp_path)
    assert names(tmp_path) == ["link", "sub"]
    assert names(tmp_path / "sub") == ["a.partial"]
    assert precious.exists()
