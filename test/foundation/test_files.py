"""Files are written atomically, and outputs never overwrite inputs."""

import os
import stat

import pytest

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_outputs, replacing, write_text


def test_a_file_is_replaced_and_keeps_its_permissions(tmp_path):
    target = tmp_path / "a.yaml"
    target.write_text("old")
    target.chmod(0o640)
    write_text(target, "new\n")
    assert target.read_text() == "new\n"
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    assert [path.name for path in tmp_path.iterdir()] == ["a.yaml"]
    write_text(tmp_path / "a", "")  # as any new file
    (tmp_path / "b").touch()
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "b").stat().st_mode


def test_a_link_is_kept_and_its_target_is_written(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    write_text(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"


def test_a_failure_midway_leaves_the_old_file_and_nothing_else(tmp_path):
    target = tmp_path / "a"
    target.write_text("old")

    def write_half():
        with replacing(target) as stream:
            stream.write(b"half of the ne")
            raise OSError("the disk is full")

    with pytest.raises(OSError, match="full"):
        write_half()
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


@pytest.mark.parametrize(
    ("outputs", "words"),
    [
        ({"--json": "robot.yaml"}, "--json robot.yaml would overwrite the input robot.yaml"),
        ({"--json": "./sub/../robot.yaml"}, "would overwrite the input robot.yaml"),
        ({"--json": "link"}, "would overwrite the input robot.yaml"),
        ({"--html": "bag/metadata.yaml"}, "would overwrite the input bag"),
        ({"--json": "a", "--html": "sub/../a"}, "--html and --json both name sub/../a"),
        ({"--json": "sub"}, "--json sub is a folder"),
        ({"--out": "missing/a"}, "--out missing/a: there is no folder missing"),
    ],
)
def test_impossible_outputs_are_refused_before_any_work(tmp_path, monkeypatch, outputs, words):
    monkeypatch.chdir(tmp_path)
    for folder in ("sub", "bag"):
        (tmp_path / folder).mkdir()
    (tmp_path / "robot.yaml").touch()
    (tmp_path / "link").symlink_to("robot.yaml")
    with pytest.raises(UsageError, match=words):
        check_outputs(outputs, ["robot.yaml", "bag"])
    check_outputs({"--json": "a.json", "--html": None}, ["robot.yaml"])


def test_a_pipe_is_written_to_and_not_replaced(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    check_outputs({"--json": pipe})
    write_text(pipe, "figures")
    assert os.read(reading, 100) == b"figures"
    os.close(reading)
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_an_unpaired_surrogate_does_not_end_a_write(tmp_path):
    write_text(tmp_path / "a", '"bag\udcff"')
    assert (tmp_path / "a").read_bytes() == b'"bag\\udcff"'


def test_a_full_disk_is_reported_with_the_name_of_the_file(tmp_path):
    full = tmp_path / "full"
    full.symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left on device") as found:
        write_text(full, "a")
    assert found.value.filename == str(full)
