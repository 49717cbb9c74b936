"""Tests of the farm on this machine: `DEMO=target/release/demo pytest --tuff examples/farm`.

The pictures are held against the demo's own, without Ray and without tiles.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import render
from PIL import Image

HERE = Path(__file__).parent
DEMO = Path(os.environ.get("DEMO", "target/release/demo")).resolve()
SIZE, SPP = "160x90", "2"


def command(out, *arguments):
    words = [sys.executable, HERE / "render.py", "--demo", DEMO, "--tuff", "installed", "--size", SIZE, "--spp", SPP]
    return [*map(str, words), "--out", str(out), *arguments]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Digests of the frames 0 to 2, by the demo alone."""
    folder = tmp_path_factory.mktemp("whole")
    digests = []
    for frame in range(3):
        out = folder / f"{frame}.png"
        subprocess.run([DEMO, "--size", SIZE, "--spp", SPP, "--frame", str(frame), "--out", out], check=True)
        digests.append(render.digest(Image.open(out)))
    assert len(set(digests)) == 3, "the waves move"
    return digests


def rendered(folder):
    return [render.digest(Image.open(path)) for path in sorted(folder.glob("*.png"))]


@pytest.mark.parametrize("workers", ["1", "4"])
def test_pictures_do_not_depend_on_workers(workers, whole, tmp_path):
    subprocess.run(command(tmp_path, "--workers", workers, "--frames", "0-2", "--tiles", "3", "--check", "0.5"), check=True)
    assert rendered(tmp_path) == whole


def test_a_killed_worker_loses_nothing(whole, tmp_path):
    farm = subprocess.Popen(command(tmp_path, "--workers", "2", "--frames", "0-2", "--tiles", "4", "--check", "0"))
    killed = None
    deadline = time.monotonic() + 120
    while killed is None and farm.poll() is None and time.monotonic() < deadline:
        killed = next(workers_of(farm.pid), None)
        time.sleep(0.02)
    assert killed is not None, "a worker was at work"
    os.kill(killed, signal.SIGKILL)
    assert farm.wait(timeout=300) == 0
    assert rendered(tmp_path) == whole


def workers_of(session):
    """Ray's processes that render right now, and that descend from this one."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes()
            if words.startswith(b"ray::render_tile") and session in ancestors(int(folder.name)):
                yield int(folder.name)
        except OSError:
            continue


def ancestors(process):
    while process > 1:
        yield process
        status = Path(f"/proc/{process}/stat").read_text()
        process = int(status.rpartition(")")[2].split()[1])


def tile(**changes):
    job = render.Job(frame=3, tile=1, tiles=4, threads=1)
    values = {"job": job, "png": b"", "digest": "a" * 64, "rays": 1, "node": "one", "version": "tuff 0.1.0"}
    return render.Tile(**{**values, **changes})


def test_what_differs_is_told():
    render.agree([tile(), tile(node="two")])
    with pytest.raises(render.Differs, match="frame 3, tile 1: one with 1 threads gave a+, two with 1 gave b+"):
        render.agree([tile(), tile(node="two", digest="b" * 64)])
    with pytest.raises(render.Differs, match="different versions of Tuff: one has tuff 0.1.0, two has tuff 0.2.0"):
        render.agree([tile(), tile(node="two", version="tuff 0.2.0")])


def test_a_share_is_rendered_twice():
    options = render.parse(["--demo", "x", "--frames", "0-3", "--tiles", "4", "--check", "0.25", "--threads", "2"])
    jobs = render.jobs(options)
    assert len(jobs) == 16 + 4
    assert {job.threads for job in jobs[16:]} == {1}
    options.check = 0
    assert len(render.jobs(options)) == 16
