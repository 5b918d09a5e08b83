"""Is every image there, whole, of the size and kind that the manifest says?

All headers are read, and the last bytes of every file: a file that was cut off lacks its end mark.
Only suspects are decoded as a whole.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

from imodbatch.checkup.finding import ERROR, WARNING, Finding, Outcome, camera_settings
from imodbatch.checkup.subject import Subject
from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import DataError
from imodbatch.datasets.images import (
    UnreadableImageError,
    check_color_mode,
    check_depth_mode,
    probe,
    read_color,
    read_depth,
)
from imodbatch.datasets.registry import miscount

Progress = Callable[[Iterable[int]], Iterable[int]]
PNG_END, JPEG_END = b"IEND\xaeB`\x82", b"\xff\xd9"
MOST_NAMED = 3
CENTERED_SHARE = 0.1


def check_files(subject: Subject, progress: Progress = iter) -> tuple[Outcome, Outcome]:
    """The checks `files` (whole, right kind) and `image_size`."""
    damaged: list[str] = []
    wrong_kind: list[str] = []
    sizes: dict[str, Counter[tuple[int, int]]] = {"color": Counter(), "depth": Counter()}
    examples: dict[tuple[str, tuple[int, int]], str] = {}
    without_depth = [f.frame_index for f in subject.files if f.depth_path is None]
    for position in progress(range(len(subject.files))):
        file = subject.files[position]
        for kind, relative in (("color", file.color_path), ("depth", file.depth_path)):
            if relative is None:
                continue
            path = subject.manifest.root_path / relative
            try:
                width, height, mode = probe(path)
                if not _has_end_mark(path):
                    _decode(path, kind)
                (check_color_mode if kind == "color" else check_depth_mode)(path, mode)
            except UnreadableImageError as error:
                damaged.append(str(error))
                continue
            except DataError as error:
                wrong_kind.append(str(error))
                continue
            sizes[kind][width, height] += 1
            examples.setdefault((kind, (width, height)), str(path))
    n_images = 2 * len(subject.files) - len(without_depth)
    findings = [
        *_listed(damaged, n_images, "missing or damaged"),
        *_listed(wrong_kind, n_images, "of the wrong kind"),
        *_without_depth(without_depth, len(subject.files)),
        *_miscount(subject),
    ]
    summary = f"{len(subject.files)} frames, {n_images} images there and whole"
    if findings:
        summary = f"{len(subject.files)} frames, {n_images} images"
    return (
        Outcome("files", summary, tuple(findings)),
        _size_outcome(subject, sizes, examples),
    )


def _has_end_mark(path: Path) -> bool:
    """Whether the file ends as its format does; bytes may follow, so no is only a suspicion."""
    try:
        with path.open("rb") as file:
            file.seek(max(path.stat().st_size - 16, 0))
            tail = file.read()
    except OSError:
        return False
    return PNG_END in tail or tail.rstrip(b"\x00").endswith(JPEG_END)


def _decode(path: Path, kind: str) -> None:
    if kind == "color":
        read_color(path)
    else:
        read_depth(path, 1.0, ())


def _listed(messages: list[str], n_images: int, what: str) -> list[Finding]:
    """One finding that names the first few files."""
    if not messages:
        return []
    more = len(messages) - MOST_NAMED
    rest = f" And {more} more." if more > 0 else ""
    seen = f"{len(messages)} of {n_images} images {what}: {' '.join(messages[:MOST_NAMED])}{rest}"
    return [Finding(ERROR, seen, figures={"n_images": len(messages)})]


def _without_depth(frame_index: list[int], n_frames: int) -> list[Finding]:
    if not frame_index:
        return []
    named = ", ".join(map(str, frame_index[:MOST_NAMED]))
    seen = (
        f"{len(frame_index)} of {n_frames} frames have no depth image (frame {named}"
        f"{', …' if len(frame_index) > MOST_NAMED else ''}): their boxes get no place. "
        "Check images.depth and images.max_gap_ms."
    )
    severity = ERROR if len(frame_index) == n_frames else WARNING
    return [Finding(severity, seen, figures={"n_frames": len(frame_index)})]


def _miscount(subject: Subject) -> list[Finding]:
    """Another number of frames than the manifest expects of the whole sequence."""
    counted = miscount(subject.manifest, subject.sequence)
    return [Finding(WARNING, counted[1], figures={"n_frames": counted[0]})] if counted else []


def _size_outcome(
    subject: Subject,
    sizes: dict[str, Counter[tuple[int, int]]],
    examples: dict[tuple[str, tuple[int, int]], str],
) -> Outcome:
    findings = []
    cameras = {"color": subject.cameras.color, "depth": subject.cameras.depth}
    for kind, camera in cameras.items():
        expected = (camera.width_px, camera.height_px)
        others = {size: n for size, n in sizes[kind].items() if size != expected}
        if not others:
            continue
        size = max(others, key=lambda s: others[s])
        n_images = sum(sizes[kind].values())
        seen = (
            f"{sum(others.values())} of {n_images} {kind} images are not {expected[0]}×"
            f"{expected[1]} as camera.{kind} says: {examples[kind, size]} is {size[0]}×{size[1]}."
        )
        is_common = len(sizes[kind]) == 1
        mend = _camera_lines(kind, camera, size) if is_common else ()
        cure = "" if is_common else " Restore those files, or leave their frames out."
        findings.append(
            Finding(ERROR, seen + cure, mend, {"width_px": size[0], "height_px": size[1]})
        )
    said = ", ".join(f"{k} {c.width_px}×{c.height_px}" for k, c in cameras.items())
    return Outcome("image_size", said, tuple(findings))


def _camera_lines(kind: str, camera: PinholeCamera, size: tuple[int, int]) -> tuple[str, ...]:
    """Size for the manifest; the intrinsics too unless their centre is that of the new size."""
    lines = camera_settings(kind, width_px=size[0], height_px=size[1])
    off_center = (
        abs(camera.cx_px - size[0] / 2) / size[0],
        abs(camera.cy_px - size[1] / 2) / size[1],
    )
    if max(off_center) > CENTERED_SHARE:
        across, down = size[0] / camera.width_px, size[1] / camera.height_px
        lines += camera_settings(
            kind,
            **{"fx_px": camera.fx_px * across, "fy_px": camera.fy_px * down},
            **{"cx_px": camera.cx_px * across, "cy_px": camera.cy_px * down},
        )
    return lines
