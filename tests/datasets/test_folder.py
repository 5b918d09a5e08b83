"""A plain folder: patterns, partners, stamps and slices, by the manifest alone."""

import pytest

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import ConfigError, DataError, ImodError
from imodbatch.datasets import folder
from imodbatch.datasets.patterns import PathPattern, natural_key
from imodbatch.datasets.registry import camera_model, layout_of
from imodbatch.settings.manifest import Manifest
from imodbatch.settings.sections import ReferenceSection

COLOR = {"width_px": 64, "height_px": 48, "fx_px": 50, "fy_px": 50, "cx_px": 32, "cy_px": 24}
S = 1_000_000_000


def touch(base, *names):
    for name in names:
        path = base / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def split(root, images, frames=None, **more):
    return Manifest(
        name="tiny",
        adapter="folder",
        root=str(root),
        classes=["mug"],
        images=images,
        sequences=[{"id": "s", "path": "walk", "frames": frames}],
        **more,
    )


def listed(root, images, frames=None):
    manifest = split(root, images, frames)
    return folder.LAYOUT.frames(manifest, manifest.sequences[0])


def numbers(files):
    return [file.frame_index for file in files]


def depths(files):
    return {file.frame_index: file.depth_path for file in files}


def fault(action, *mentions, kind=DataError):
    with pytest.raises(ImodError) as caught:
        action()
    assert type(caught.value) is kind
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    for mention in mentions:
        assert str(mention) in text


def test_numbers_are_the_datasets_own(tmp_path):
    touch(tmp_path / "walk", "color/7.png", "color/0012.png", "color/100.png", "color/a.png")
    touch(tmp_path / "walk", "color/7.jpg", "color/x7.png", "color/7.png.bak", "color/sub/1.png")
    files = listed(tmp_path, {"color": "color/{frame}.png"})
    assert numbers(files) == [7, 12, 100]
    assert [f.color_path for f in files] == [
        "walk/color/7.png",
        "walk/color/0012.png",
        "walk/color/100.png",
    ]
    assert all(f.depth_path is None and f.timestamp_ns is None for f in files)


def test_depth_has_the_same_number_with_or_without_zeros(tmp_path):
    touch(tmp_path / "walk", *(f"color/{i}.png" for i in (1, 2, 3, 10)))
    touch(tmp_path / "walk", *(f"depth/{i:05d}.png" for i in (1, 3, 4)))
    files = listed(tmp_path, {"color": "color/{frame}.png", "depth": "depth/{frame}.png"})
    assert depths(files) == {
        1: "walk/depth/00001.png",
        2: None,
        3: "walk/depth/00003.png",
        10: None,
    }


def test_colour_and_depth_in_one_folder(tmp_path):
    touch(tmp_path / "walk", "desk_1.png", "desk_1_depth.png", "desk_2.png", "desk_2_depth.png")
    files = listed(tmp_path, {"color": "desk_{frame}.png", "depth": "desk_{frame}_depth.png"})
    assert depths(files) == {1: "walk/desk_1_depth.png", 2: "walk/desk_2_depth.png"}


def test_no_depth_folder_at_all(tmp_path):
    touch(tmp_path / "walk", "color/1.png")
    images = {"color": "color/{frame}.png", "depth": "depth/{frame}.png"}
    assert depths(listed(tmp_path, images)) == {1: None}


def test_names_are_numbered_in_natural_order(tmp_path):
    touch(tmp_path / "walk", *(f"color/view{i}.png" for i in (10, 9, 1, 2)), "color/b.png")
    files = listed(tmp_path, {"color": "color/{name}.png"})
    assert numbers(files) == [0, 1, 2, 3, 4]
    assert [f.color_path.rsplit("/", 1)[1] for f in files] == [
        "b.png",
        "view1.png",
        "view2.png",
        "view9.png",
        "view10.png",
    ]


def test_natural_order():
    names = ["a10b2", "a10b10", "a9", "b", "10", "9", "a", "²", ""]
    assert sorted(names, key=natural_key) == ["", "9", "10", "a", "a9", "a10b2", "a10b10", "b", "²"]


def test_depth_of_the_same_name(tmp_path):
    touch(tmp_path / "walk", "rgb/a.png", "rgb/b.png", "rgb/c 1.png")
    touch(tmp_path / "walk", "d/c 1_depth.png", "d/a_depth.png", "d/z_depth.png")
    files = listed(tmp_path, {"color": "rgb/{name}.png", "depth": "d/{name}_depth.png"})
    assert depths(files) == {0: "walk/d/a_depth.png", 1: None, 2: "walk/d/c 1_depth.png"}


def test_stamps_are_exact_and_in_order(tmp_path):
    touch(tmp_path / "walk", "rgb/1305031102.175304.png", "rgb/1305031102.2.png", "rgb/999.png")
    files = listed(tmp_path, {"color": "rgb/{stamp}.png"})
    assert numbers(files) == [0, 1, 2]
    assert [f.timestamp_ns for f in files] == [999 * S, 1305031102175304000, 1305031102200000000]


def test_depth_of_the_nearest_stamp_within_the_gap(tmp_path):
    touch(tmp_path / "walk", *(f"rgb/{s}.png" for s in ("10.00", "10.10", "10.20", "10.30")))
    touch(tmp_path / "walk", *(f"d/{s}.png" for s in ("10.015", "10.07", "10.112", "10.221")))
    images = {"color": "rgb/{stamp}.png", "depth": "d/{stamp}.png", "max_gap_ms": 20}
    expected = {0: "walk/d/10.015.png", 1: "walk/d/10.112.png", 2: None, 3: None}
    assert depths(listed(tmp_path, images)) == expected
    wider = {0: "walk/d/10.015.png", 1: "walk/d/10.112.png", 2: "walk/d/10.221.png", 3: None}
    assert depths(listed(tmp_path, {**images, "max_gap_ms": 21})) == wider


def test_a_depth_image_serves_one_frame(tmp_path):
    touch(tmp_path / "walk", "rgb/1.00.png", "rgb/1.01.png", "d/1.006.png")
    images = {"color": "rgb/{stamp}.png", "depth": "d/{stamp}.png"}
    assert depths(listed(tmp_path, images)) == {0: None, 1: "walk/d/1.006.png"}


def test_stamps_in_nanoseconds_are_refused(tmp_path):
    touch(tmp_path / "walk", "rgb/1403636579763555584.png")
    fault(lambda: listed(tmp_path, {"color": "rgb/{stamp}.png"}), "no moment in seconds", "{name}")


def test_a_file_of_timestamps(tmp_path):
    touch(tmp_path / "walk", *(f"c/{i}.png" for i in (1, 2, 10)))
    text = "# stamp file\n\n1305031102.175304 rgb/1.png\n5   # the second\n6.25\n"
    (tmp_path / "walk" / "stamps.txt").write_text(text)
    images = {"color": "c/{frame}.png", "timestamps": "stamps.txt"}
    files = listed(tmp_path, images)
    assert [f.timestamp_ns for f in files] == [1305031102175304000, 5 * S, 6_250_000_000]
    sliced = listed(tmp_path, images, frames="2:")
    assert [(f.frame_index, f.timestamp_ns) for f in sliced] == [(2, 5 * S), (10, 6_250_000_000)]


@pytest.mark.parametrize("text", ["1.0\n2.0\n", "1\n2\n3\n4\n", ""])
def test_a_file_of_timestamps_has_one_line_per_image(tmp_path, text):
    touch(tmp_path / "walk", *(f"c/{i}.png" for i in (1, 2, 10)))
    path = tmp_path / "walk" / "stamps.txt"
    path.write_text(text)
    images = {"color": "c/{frame}.png", "timestamps": "stamps.txt"}
    n = len(text.splitlines())
    fault(lambda: listed(tmp_path, images), path, f"{n} stamps for 3 colour images")


@pytest.mark.parametrize(
    "content", [b"soon\n", b"1,5\n", b"nan\n", b"1e30\n", b"\xff\xfe1\n", None]
)
def test_a_bad_file_of_timestamps(tmp_path, content):
    touch(tmp_path / "walk", "c/1.png")
    path = tmp_path / "walk" / "stamps.txt"
    if content is not None:
        path.write_bytes(content)
    images = {"color": "c/{frame}.png", "timestamps": "stamps.txt"}
    fault(lambda: listed(tmp_path, images), path, "a stamp in seconds per line")


def test_frames_per_second(tmp_path):
    touch(tmp_path / "walk", *(f"c/{i}.png" for i in (0, 3, 10)))
    files = listed(tmp_path, {"color": "c/{frame}.png", "frames_per_second": 30})
    assert [f.timestamp_ns for f in files] == [0, S // 10, 333_333_333]


@pytest.mark.parametrize(
    ("frames", "kept"),
    [("2:4", [2, 3]), ("::2", [0, 2, 4]), ("1::3", [1, 4]), ("4:2", []), ("3:", [3, 4])],
)
def test_slices_go_by_number(tmp_path, frames, kept):
    touch(tmp_path / "walk", *(f"{i}.png" for i in range(5)))
    assert numbers(listed(tmp_path, {"color": "{frame}.png"}, frames)) == kept


def test_slices_do_not_renumber_names(tmp_path):
    touch(tmp_path / "walk", *(f"{name}.png" for name in "abcde"))
    files = listed(tmp_path, {"color": "{name}.png"}, "3:")
    assert [(f.frame_index, f.color_path) for f in files] == [(3, "walk/d.png"), (4, "walk/e.png")]


@pytest.mark.parametrize("special", ["a.b", "c[1]", "(x)", "x+", "^x$", "a|b", "n{3}", "\\d"])
def test_a_pattern_is_no_regular_expression(tmp_path, special):
    if special == "n{3}":
        with pytest.raises(ConfigError, match="exactly one of"):
            PathPattern(f"{special}_{{frame}}.png")
        return
    touch(tmp_path / "walk" / special, f"{special}_5.png", "axb_6.png", "c1_7.png", "xx_8.png")
    files = listed(tmp_path, {"color": f"{special}/{special}_{{frame}}.png"})
    assert numbers(files) == [5]


def test_the_dot_of_an_ending_is_a_dot(tmp_path):
    touch(tmp_path / "walk", "1.png", "2xpng")
    assert numbers(listed(tmp_path, {"color": "{frame}.png"})) == [1]


@pytest.mark.parametrize(
    "pattern",
    [
        "color.png",
        "{frame}_{stamp}.png",
        "{frame}{frame}.png",
        "{number}.png",
        "{frame}/color.png",
        "{frame}/x{.png",
        "{frame:06d}.png",
        "{}.png",
    ],
)
def test_bad_patterns(tmp_path, pattern):
    (tmp_path / "walk").mkdir()
    fault(
        lambda: listed(tmp_path, {"color": pattern}),
        repr(pattern),
        "exactly one of {frame}, {stamp}, {name}",
        kind=ConfigError,
    )


def test_colour_and_depth_need_the_same_field(tmp_path):
    touch(tmp_path / "walk", "c/1.png", "d/1.png")
    images = {"color": "c/{frame}.png", "depth": "d/{stamp}.png"}
    fault(lambda: listed(tmp_path, images), "images.depth", "{stamp}", "{frame}", kind=ConfigError)


def test_a_missing_folder_has_no_frames(tmp_path):
    assert listed(tmp_path, {"color": "c/{frame}.png"}) == []


def test_without_images_there_is_no_way_to_know(tmp_path):
    fault(lambda: listed(tmp_path, None), "[images]", "color/{frame}.png", kind=ConfigError)


def test_the_camera_must_be_given(tmp_path):
    manifest = split(tmp_path, {"color": "{frame}.png"})
    fault(lambda: camera_model(manifest), "camera.color", "fx_px", kind=ConfigError)


def test_depth_is_registered_millimetres_unless_the_manifest_says_more(tmp_path):
    images, camera = {"color": "{frame}.png"}, PinholeCamera(64, 48, 50, 50, 32, 24)
    plain = camera_model(split(tmp_path, images, camera={"color": COLOR}))
    assert (plain.color, plain.depth) == (camera, camera)
    assert (plain.depth_scale_m, plain.depth_invalid, plain.color_from_depth) == (0.001, (0,), None)
    depth = {**COLOR, "fx_px": 60, "scale_m": 0.0002, "invalid": [0, 9]}
    own = camera_model(split(tmp_path, images, camera={"color": COLOR, "depth": depth}))
    assert (own.color, own.depth) == (camera, PinholeCamera(64, 48, 60, 50, 32, 24))
    assert (own.depth_scale_m, own.depth_invalid) == (0.0002, (0, 9))


def test_unknown_adapters(tmp_path):
    manifest = split(tmp_path, None).model_copy(update={"adapter": "foldr"})
    fault(lambda: layout_of(manifest), "'foldr'", "Did you mean 'folder'?", kind=ConfigError)


def test_odometry_is_what_the_manifest_points_at(tmp_path):
    touch(tmp_path / "walk", "1.png", "2.png")
    (tmp_path / "walk" / "t.txt").write_text("1 2 3 4 0 0 0 1\n")
    plain = split(tmp_path, {"color": "{frame}.png"})
    section = plain.sequences[0]
    assert folder.LAYOUT.odometry(plain, section) is None
    assert folder.LAYOUT.odometry_files(plain, section) == []
    given = split(tmp_path, {"color": "{frame}.png"}, odometry={"format": "tum", "path": "t.txt"})
    assert folder.LAYOUT.odometry_files(given, section) == [tmp_path / "walk" / "t.txt"]
    assert folder.LAYOUT.odometry(given, section).timestamp_ns.tolist() == [S]


def test_the_reference_is_what_the_manifest_points_at_and_nothing_else(tmp_path):
    touch(tmp_path / "walk", "1.png", "2.png")
    (tmp_path / "walk" / "t.txt").write_text("1 2 3 4 0 0 0 1\n")
    (tmp_path / "walk" / "true.txt").write_text("2 5 6 7 0 0 0 1\n")
    odometry = {"format": "tum", "path": "t.txt"}
    plain = split(tmp_path, {"color": "{frame}.png"}, odometry=odometry)
    section = plain.sequences[0]
    assert folder.LAYOUT.reference(plain, section) is None
    assert folder.LAYOUT.reference_files(plain, section) == []
    given = plain.model_copy(
        update={"reference": ReferenceSection(format="tum", path="true.txt", unit_m=0.5)}
    )
    assert folder.LAYOUT.reference_files(given, section) == [tmp_path / "walk" / "true.txt"]
    assert folder.LAYOUT.odometry_files(given, section) == [tmp_path / "walk" / "t.txt"]
    true = folder.LAYOUT.reference(given, section)
    assert true.timestamp_ns.tolist() == [2 * S]
    assert true.world_from_color[0, :3, 3].tolist() == [2.5, 3, 3.5]


@pytest.mark.parametrize("frames", [None, "2:4"])
def test_a_kitti_file_is_counted_from_the_sequences_first_frame(tmp_path, frames):
    """A slice must not move the lines: frame 1 has line 1 with it and without it."""
    touch(tmp_path / "walk", *(f"{i}.png" for i in range(1, 7)))
    lines = [f"1 0 0 {i} 0 1 0 0 0 0 1 0" for i in range(1, 7)]
    (tmp_path / "walk" / "k.txt").write_text("\n".join(lines))
    odometry = {"format": "kitti", "path": "k.txt"}
    manifest = split(tmp_path, {"color": "{frame}.png"}, frames, odometry=odometry)
    section = manifest.sequences[0]
    found = folder.LAYOUT.odometry(manifest, section)
    assert found.frame_index.tolist() == [1, 2, 3, 4, 5, 6]
    assert found.world_from_color[:, 0, 3].tolist() == [1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize(
    "adapter", ["seven_scenes", "scannet", "tum", "rgbd_scenes_v1", "rgbd_scenes_v2"]
)
def test_patterns_that_a_layout_would_not_look_at_are_refused(tmp_path, adapter):
    manifest = split(tmp_path, {"color": "{frame}.png"}).model_copy(update={"adapter": adapter})
    fault(
        lambda: layout_of(manifest),
        f"images.color means nothing to the adapter '{adapter}'",
        "takes images from",
        kind=ConfigError,
    )
