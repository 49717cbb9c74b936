"""Renders frames of Tuff's demo on a Ray cluster, tile by tile, and asserts that every machine gives the same bits.

    python render.py --demo target/release/demo --frames 0-23 --tiles 4                       # this machine
    python render.py --demo target/release/demo --frames 0-23 --tiles 4 --address auto        # a cluster

A task is one tile of one frame. A machine that goes away costs only the tiles that it was rendering: Ray starts them again elsewhere.
A share of the tiles (--check) is rendered a second time, by another task with another number of threads, and must hash alike: with a
driver whose results do not depend on the machine, that finds machines that do.
"""

import argparse
import hashlib
import io
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import List, NamedTuple

import ray
from PIL import Image


class Job(NamedTuple):
    """One tile of one frame, by one number of threads."""

    frame: int
    tile: int
    tiles: int
    threads: int


@dataclass
class Tile:
    """A rendered tile, and who rendered it."""

    job: Job
    png: bytes
    #: SHA-256 of size and pixels.
    digest: str
    rays: int
    node: str
    version: str


def digest(picture: Image.Image) -> str:
    """SHA-256 of a picture's size and pixels, whatever file they lie in."""
    return hashlib.sha256(repr(picture.size).encode() + picture.convert("RGB").tobytes()).hexdigest()


def program(binary: bytes) -> Path:
    """The demo as a file of this machine: written once, under a name that its contents give."""
    path = Path(tempfile.gettempdir()) / f"tuff-demo-{os.getuid()}-{hashlib.sha256(binary).hexdigest()[:16]}"
    if not path.exists():
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            file.write(binary)
        os.chmod(file.name, 0o700)
        # Two workers may do this at a time: either file is whole.
        os.replace(file.name, path)
    return path


def render_tile(binary: bytes, job: Job, size: str, spp: int) -> Tile:
    """Renders one tile here."""
    import tuff

    version = subprocess.run([tuff.program(), "--version"], capture_output=True, text=True, check=True).stdout.strip()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "tile.png"
        command = [tuff.program(), "run", "--", program(binary), "--size", size, "--spp", str(spp)]
        command += ["--frame", str(job.frame), "--tile", f"{job.tile}/{job.tiles}"]
        command += ["--threads", str(job.threads), "--out", out]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"{os.uname().nodename}: {done.stderr.strip() or done.returncode}")
        png = out.read_bytes()
    rays = next(part for part in done.stdout.split(", ") if part.endswith(" rays"))
    return Tile(
        job=job,
        png=png,
        digest=digest(Image.open(io.BytesIO(png))),
        rays=int(rays.split()[0]),
        node=os.uname().nodename,
        version=version,
    )


def jobs(options: argparse.Namespace) -> List[Job]:
    """All tiles of all frames, and after them those that are rendered again, by half or twice the threads."""
    first = [Job(frame, tile, options.tiles, options.threads) for frame in options.frames for tile in range(options.tiles)]
    others = options.threads // 2 or 2
    step = max(1, round(1 / options.check)) if options.check else len(first) + 1
    return first + [job._replace(threads=others) for job in first[::step] if options.check]


class Differs(Exception):
    """The same tile came out differently."""


def agree(tiles: List[Tile]) -> None:
    """Raises where machines have other versions of Tuff, or where a tile that was rendered twice differs."""
    versions = {tile.version: tile.node for tile in tiles}
    if len(versions) > 1:
        told = ", ".join(f"{node} has {version}" for version, node in sorted(versions.items()))
        raise Differs(f"the machines have different versions of Tuff: {told}; install the same on all, or pin it by --tuff")
    seen = {}
    for tile in tiles:
        other = seen.setdefault((tile.job.frame, tile.job.tile), tile)
        if other.digest != tile.digest:
            raise Differs(
                f"frame {tile.job.frame}, tile {tile.job.tile}: {other.node} with {other.job.threads} threads gave {other.digest[:16]}, "
                f"{tile.node} with {tile.job.threads} gave {tile.digest[:16]}"
            )


def merged(tiles: List[Tile]) -> Image.Image:
    """A frame from its tiles, which lie below each other in order."""
    bands = [Image.open(io.BytesIO(tile.png)) for tile in sorted(tiles, key=lambda tile: tile.job.tile)]
    picture = Image.new("RGB", (bands[0].width, sum(band.height for band in bands)))
    top = 0
    for band in bands:
        picture.paste(band, (0, top))
        top += band.height
    return picture


def show(done: int, total: int, rays: int, started: float) -> None:
    """The progress bar."""
    filled = 30 * done // total
    rate = rays / max(time.monotonic() - started, 1e-3) / 1e6
    print(f"\r[{'#' * filled}{' ' * (30 - filled)}] {done} of {total} tiles, {rate:.2f} million rays/s", end="", file=sys.stderr)


def frames(text: str) -> range:
    """Frames from `FIRST-LAST` or `ONE`."""
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def parse(arguments: List[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--demo", type=Path, required=True, help="the demo's program, as `cargo xtask demo` leaves it in target/release")
    parser.add_argument("--frames", type=frames, default=range(1), help="FIRST-LAST, 24 a second")
    parser.add_argument("--tiles", type=int, default=4, help="tiles a frame")
    parser.add_argument("--size", default="640x360")
    parser.add_argument("--spp", type=int, default=4, help="samples per pixel")
    parser.add_argument("--threads", type=int, default=1, help="threads (and Ray CPUs) a task")
    parser.add_argument("--check", type=float, default=0.25, help="the share of tiles that is rendered twice, 0 to 1")
    parser.add_argument("--out", type=Path, default=Path("frames"), help="the folder of pictures")
    parser.add_argument("--address", help="a cluster: `auto`, or ray://HOST:PORT; otherwise this machine")
    parser.add_argument("--workers", type=int, help="CPUs that Ray may use on this machine")
    parser.add_argument(
        "--tuff", default="tuff-vulkan", help="what pip installs on each machine; `installed`: the machines have it already"
    )
    return parser.parse_args(arguments)


def render(options: argparse.Namespace) -> List[str]:
    """Renders all frames into files; their digests."""
    environment = {} if options.tuff == "installed" else {"pip": [options.tuff]}
    local = {} if options.address else {"num_cpus": options.workers}
    ray.init(address=options.address, runtime_env=environment, log_to_driver=False, **local)
    try:
        # Tiles go to all machines alike; one whose machine dies, or whose program does, is rendered again.
        task = ray.remote(max_retries=5, retry_exceptions=True, scheduling_strategy="SPREAD")(render_tile)
        binary = ray.put(options.demo.read_bytes())
        started, rays, tiles = time.monotonic(), 0, []
        todo = jobs(options)
        waiting = [task.options(num_cpus=options.threads).remote(binary, job, options.size, options.spp) for job in todo]
        while waiting:
            (ready, *_), waiting = ray.wait(waiting)
            tiles.append(ray.get(ready))
            rays += tiles[-1].rays
            show(len(tiles), len(todo), rays, started)
        print(file=sys.stderr)
    finally:
        ray.shutdown()
    agree(tiles)
    options.out.mkdir(parents=True, exist_ok=True)
    digests = []
    for frame in options.frames:
        # Where a tile came twice either serves: they are equal.
        of_frame = {tile.job.tile: tile for tile in tiles if tile.job.frame == frame}
        picture = merged(list(of_frame.values()))
        path = options.out / f"frame-{frame:04}.png"
        picture.save(path)
        digests.append(digest(picture))
        print(f"{digests[-1]}  {path}")
    twice = len(todo) - len(options.frames) * options.tiles
    nodes = len({tile.node for tile in tiles})
    print(f"{len(tiles)} tiles on {nodes} machine(s), {twice} of them rendered twice and equal, {rays / 1e6:.1f} million rays")
    return digests


def main() -> None:
    options = parse(sys.argv[1:])
    if not options.demo.exists():
        sys.exit(f"there is no {options.demo}: `cargo xtask demo` builds it")
    try:
        render(options)
    except Differs as error:
        sys.exit(f"error: {error}")
    except ray.exceptions.RayTaskError as error:
        sys.exit(f"error: {error.cause}")
    except (ConnectionError, RuntimeError) as error:
        # Among them a cluster of another version of Ray or Python, which says so.
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
