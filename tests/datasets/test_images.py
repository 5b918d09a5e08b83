"""Images: right numbers or an error, never a part of a picture."""

import struct
import subprocess
import zlib

import cv2
import numpy as np
import pytest
from PIL import EpsImagePlugin, Image

from imodbatch.core.errors import DataError
from imodbatch.datasets.images import (
    UnreadableImageError,
    check_depth_mode,
    only_listed_formats,
    probe,
    read_color,
    read_depth,
)
from imodbatch.lab.models.loading import load_model
from imodbatch.lab.pictures.backgrounds import random_background

HEIGHT, WIDTH = 120, 160
ROWS, COLUMNS = np.mgrid[0:HEIGHT, 0:WIDTH]
NOISE = np.random.default_rng(0)
RGB = np.stack([COLUMNS, 2 * ROWS, (ROWS * COLUMNS) % 256], axis=-1).astype(np.uint8)
RGB[40:80, 50:110] = NOISE.integers(0, 256, (40, 60, 3))
GREY = RGB[..., 2]
RAW = (800 + 9 * ROWS + 5 * COLUMNS + NOISE.integers(0, 40, ROWS.shape)).astype(np.uint16)
RAW[0, :4] = 0, 65535, 1, 65534


def saved(path, image, **options):
    (image if isinstance(image, Image.Image) else Image.fromarray(image)).save(path, **options)
    return path


def chunked_png(path, pixels):
    """A PNG of many IDAT chunks, as most cameras' software writes them."""
    bgr = pixels[..., ::-1] if pixels.ndim == 3 else pixels
    assert cv2.imwrite(str(path), bgr)
    return path


def chunk_starts(png):
    place, starts = 8, []
    while place < len(png):
        starts.append(place)
        place += 12 + int.from_bytes(png[place : place + 4], "big")
    return starts


def depth_of(path, scale_m=0.001, invalid=(0,)):
    return read_depth(path, scale_m, invalid)


def fault(action, *mentions, kind=UnreadableImageError):
    with pytest.raises(DataError) as caught:
        action()
    assert type(caught.value) is kind
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    for mention in mentions:
        assert str(mention) in text


def test_rgb_is_read_as_it_was_written(tmp_path):
    image = read_color(saved(tmp_path / "a.png", RGB))
    assert image.dtype == np.uint8
    assert np.array_equal(image, RGB)


def test_grey_is_repeated(tmp_path):
    image = read_color(saved(tmp_path / "a.png", GREY))
    assert np.array_equal(image, np.repeat(GREY[..., None], 3, axis=2))


def test_alpha_is_dropped_and_does_not_darken(tmp_path):
    alpha = np.full((HEIGHT, WIDTH, 1), 7, dtype=np.uint8)
    image = read_color(saved(tmp_path / "a.png", np.concatenate([RGB, alpha], axis=2)))
    assert np.array_equal(image, RGB)
    both = Image.merge("LA", [Image.fromarray(GREY), Image.fromarray(alpha[..., 0])])
    assert np.array_equal(read_color(saved(tmp_path / "b.png", both))[..., 1], GREY)


def test_a_palette_gives_its_colours(tmp_path):
    pixels = np.zeros((4, 6, 3), dtype=np.uint8)
    pixels[:, 3:] = (200, 10, 30)
    palette = Image.fromarray(pixels).convert("P", palette=Image.Palette.ADAPTIVE)
    assert np.array_equal(read_color(saved(tmp_path / "a.png", palette)), pixels)


def test_colour_of_16_bits_keeps_the_high_byte(tmp_path):
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), (RGB[..., ::-1].astype(np.uint16) << 8) + 77)
    assert np.array_equal(read_color(path), RGB)


def test_a_depth_image_is_no_colour_image(tmp_path):
    path = saved(tmp_path / "a.png", RAW)
    fault(lambda: read_color(path), path, "I;16", "a depth image?", kind=DataError)
    path = saved(tmp_path / "a.tiff", RAW.astype(np.float32))
    fault(lambda: read_color(path), path, "'F'", kind=DataError)


def test_jpeg_has_its_size_and_about_its_colours(tmp_path):
    smooth = np.stack([COLUMNS, ROWS, ROWS], axis=-1).astype(np.uint8)
    image = read_color(saved(tmp_path / "a.jpg", smooth, quality=95))
    assert image.shape == (HEIGHT, WIDTH, 3)
    assert np.abs(image.astype(int) - smooth).max() < 12


def test_the_orientation_tag_does_not_turn_the_image(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    path = saved(tmp_path / "a.png", RGB, exif=exif)
    assert np.array_equal(read_color(path), RGB)


def test_depth_is_scaled_to_metres(tmp_path):
    path = saved(tmp_path / "a.png", RAW)
    for scale_m in (0.001, 0.0002):
        depth_m = depth_of(path, scale_m)
        assert depth_m.dtype == np.float32
        known = RAW > 0
        assert np.allclose(depth_m[known], RAW[known] * scale_m, rtol=1e-6, atol=0)


def test_invalid_numbers_are_nan_and_0_always_is(tmp_path):
    path = saved(tmp_path / "a.png", RAW)
    assert np.isnan(depth_of(path)[0, :4]).tolist() == [True, False, False, False]
    assert np.isnan(depth_of(path, invalid=(0, 65535))[0, :4]).tolist() == [
        True,
        True,
        False,
        False,
    ]
    assert np.isnan(depth_of(path, invalid=(1, 65534))[0, :4]).tolist() == [True, False, True, True]
    assert np.isnan(depth_of(path, invalid=())[0, :4]).tolist() == [True, False, False, False]
    assert np.isfinite(depth_of(path)[1:]).all()


def test_depth_of_a_big_endian_tiff(tmp_path):
    big_endian = Image.frombytes("I;16B", (WIDTH, HEIGHT), RAW.astype(">u2").tobytes())
    depth_m = depth_of(saved(tmp_path / "a.tiff", big_endian))
    assert np.array_equal(depth_m, depth_of(saved(tmp_path / "a.png", RAW)), equal_nan=True)


@pytest.mark.parametrize(
    ("pixels", "mode"),
    [(GREY, "L"), (RGB, "RGB"), (np.dstack([RGB, GREY]), "RGBA")],
    ids=["8 bits", "RGB", "RGBA"],
)
def test_previews_are_no_depth(tmp_path, pixels, mode):
    path = saved(tmp_path / "a.png", pixels)
    fault(lambda: depth_of(path), path, f"{mode!r}", "16-bit", "raw depth images", kind=DataError)


def test_floats_are_no_16_bit_depth(tmp_path):
    path = saved(tmp_path / "a.tiff", RAW.astype(np.float32))
    fault(lambda: depth_of(path), path, "'F'", kind=DataError)


def test_depth_modes():
    for mode in ("I;16", "I;16B", "I"):
        check_depth_mode("a.png", mode)
    for mode in ("1", "L", "P", "F", "RGB"):
        with pytest.raises(DataError, match="16-bit"):
            check_depth_mode("a.png", mode)


def test_the_header_alone_tells_size_and_mode(tmp_path):
    path = saved(tmp_path / "a.png", RAW)
    path.write_bytes(path.read_bytes()[:200])
    assert probe(path) == (WIDTH, HEIGHT, "I;16")


@pytest.mark.parametrize("read", [probe, read_color, depth_of])
def test_what_is_no_image(tmp_path, read):
    missing, blank, text, folder = (tmp_path / name for name in ("m.png", "b.png", "t.png", "f"))
    blank.touch()
    text.write_text("frame,x,y\n0,1,2\n")
    folder.mkdir()
    fault(lambda: read(missing), missing, "no such file")
    for path in (blank, text, folder):
        fault(lambda path=path: read(path), path, "not a readable image", "Restore the file")


def whole_files(folder):
    yield chunked_png(folder / "c.png", RGB), read_color
    yield saved(folder / "p.png", RGB), read_color
    yield chunked_png(folder / "d.png", RAW), depth_of
    yield saved(folder / "q90.jpg", RGB, quality=90), read_color
    yield saved(folder / "progressive.jpg", RGB, quality=90, progressive=True), read_color
    yield saved(folder / "restart.jpg", RGB, quality=90, restart_marker_rows=1), read_color


def some_places(data, path):
    """Every place near the start, the end and the borders of chunks, and many in between."""
    size = len(data)
    places = {*range(0, 64, 3), *range(size - 40, size), *range(0, size, max(size // 50, 1))}
    if path.suffix == ".png":
        places |= {start + shift for start in chunk_starts(data) for shift in range(-5, 13, 2)}
    return sorted(place for place in places if 0 <= place < size)


def test_a_truncated_image_is_never_returned_in_part(tmp_path):
    """Only the closing mark of a PNG, which holds no pixel, may be missing."""
    for path, read in whole_files(tmp_path):
        data, image = path.read_bytes(), read(path)
        for place in some_places(data, path):
            path.write_bytes(data[:place])
            if path.suffix == ".png" and place >= len(data) - 4:
                assert np.array_equal(read(path), image, equal_nan=image.dtype.kind == "f")
            else:
                fault(lambda read=read, path=path: read(path), path)


def test_a_tail_of_zeros_is_never_returned_as_pixels(tmp_path):
    """What a power cut leaves: the file's length is right, its last blocks were never written."""
    for path, read in whole_files(tmp_path):
        data = path.read_bytes()
        last = len(data.rstrip(b"\0")) - 4  # zeros over the closing mark's checksum do no harm
        for place in [p for p in some_places(data, path) if p < last]:
            path.write_bytes(data[:place] + bytes(len(data) - place))
            fault(lambda read=read, path=path: read(path), path)


def test_a_turned_byte_of_a_png_is_noticed(tmp_path):
    path = chunked_png(tmp_path / "d.png", RAW)
    data = path.read_bytes()
    for place in range(60, len(data) - 30, len(data) // 40):
        damaged = bytearray(data)
        damaged[place] ^= 0x10
        path.write_bytes(damaged)
        fault(lambda: depth_of(path), path)


def test_bytes_after_the_end_of_a_jpeg_do_no_harm(tmp_path):
    path = saved(tmp_path / "a.jpg", RGB)
    image = read_color(path)
    path.write_bytes(path.read_bytes() + b"trailer" + bytes(100))
    assert np.array_equal(read_color(path), image)


def test_an_impossible_size_is_an_unreadable_image(tmp_path):
    header = struct.pack(">IIBBBBB", 60000, 60000, 8, 2, 0, 0, 0)
    chunk = b"IHDR" + header
    png = (
        b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    )
    path = tmp_path / "a.png"
    path.write_bytes(png)
    fault(lambda: read_color(path), path)


EPS = b"""%!PS-Adobe-3.0 EPSF-3.0
%%BoundingBox: 0 0 8 8
%%EndComments
0 0 8 8 rectfill
%%EOF
"""


def forbidden(*arguments, **_options):
    raise AssertionError(f"started a program or another decoder: {arguments}")


@pytest.fixture(params=["EPS", "GIF", "ICO", "FITS"])
def disguised(request, tmp_path, monkeypatch):
    """A file of a format that is not listed, called .png; no program may be started for it."""
    path = tmp_path / "a.png"
    if request.param == "EPS":
        path.write_bytes(EPS)
    elif request.param == "FITS":
        head = ("SIMPLE  =                    T", "BITPIX  =                    8")
        head += ("NAXIS   =                    2", "NAXIS1  =                    8")
        head += ("NAXIS2  =                    8", "END")
        path.write_bytes("".join(f"{card:80}" for card in head).ljust(2880).encode() + bytes(2880))
    else:
        Image.new("RGB", (32, 32), (200, 10, 30)).save(path, request.param)
    with Image.open(path) as image:
        assert image.format == request.param
    for owner, name in ((subprocess, "Popen"), (EpsImagePlugin, "Ghostscript")):
        monkeypatch.setattr(owner, name, forbidden)
    monkeypatch.setattr(Image.OPEN[request.param][0], "load", forbidden, raising=False)
    return path


@pytest.mark.parametrize("read", [probe, read_color, depth_of])
def test_formats_that_are_not_listed_are_refused_whatever_their_name(disguised, read):
    fault(lambda: read(disguised), disguised, "not a readable image", "Restore the file")


def test_a_background_of_another_format_is_refused(disguised):
    rng = np.random.default_rng(0)
    fault(lambda: random_background([disguised], 8, 8, rng), disguised, "not a", kind=DataError)


@pytest.mark.parametrize("file_format", ["PNG", "JPEG", "TIFF", "PPM", "BMP", "WEBP"])
def test_listed_formats_are_read_whatever_their_name(tmp_path, file_format):
    smooth = np.stack([COLUMNS, ROWS, ROWS], axis=-1).astype(np.uint8)
    path = saved(tmp_path / "a.dat", smooth, format=file_format)
    assert np.abs(read_color(path).astype(int) - smooth).max() < 20


def test_a_grey_pgm_is_read(tmp_path):
    assert np.array_equal(depth_of(saved(tmp_path / "a.pgm", RAW), 1.0)[1:], RAW[1:])


OBJ = """mtllib box.mtl
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
vt 0 0
vt 1 0
vt 0 1
usemtl skin
f 1/1 2/2 3/3
f 1/1 2/2 4/3
f 1/1 3/2 4/3
f 2/1 3/2 4/3
"""


def test_a_texture_of_another_format_is_not_opened(disguised):
    folder = disguised.parent
    (folder / "box.obj").write_text(OBJ)
    (folder / "box.mtl").write_text("newmtl skin\nKd 0.2 0.4 0.6\nmap_Kd a.png\n")
    with pytest.warns(UserWarning, match=r"its texture 'a.png' cannot be read"):
        model = load_model(folder / "box.obj")
    assert model.mesh.texture.reshape(-1, 3).std(axis=0).max() == 0


def test_pillow_opens_all_it_knows_again_after_a_library_was_kept_to_the_list(tmp_path):
    path = saved(tmp_path / "a.gif", GREY)
    everything = Image.open
    with pytest.raises(OSError, match="cannot identify"), only_listed_formats():
        Image.open(path)
    assert Image.open is everything
    with Image.open(path) as image:
        assert image.format == "GIF"
