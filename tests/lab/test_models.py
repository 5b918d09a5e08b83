"""Loading users' object models: tiny files of each format, and real scans if they are there."""

import os
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from imodbatch.core.errors import ConfigError, DataError
from imodbatch.lab.models import load_model, load_models
from imodbatch.lab.models.atlas import make_atlas, texture_of_corner_colors, unrepeat
from imodbatch.lab.models.normals import corner_normals, weld
from imodbatch.lab.scene import render_view

DATA = os.environ.get("IMODBATCH_DATA")
SCANS = Path(DATA or ".") / "gazebo_models"
OBJ = """mtllib box.mtl
v 0 0 0
v 0.2 0 0
v 0.2 0.1 0
v 0 0.1 0
v 0.1 0.05 0.3
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl skin
f 1/1 2/2 5/3
f 2/1 3/2 5/3
f 3/1 4/2 5/3
f 4/1 1/2 5/3
f 1/1 4/4 3/3 2/2
"""


def write_obj(folder: Path, texture: str | None = "skin.png") -> Path:
    """A pyramid 20 × 10 × 30 cm, off the origin, with a texture green above and red below."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "box.obj").write_text(OBJ)
    line = f"map_Kd {texture}\n" if texture else ""
    (folder / "box.mtl").write_text(f"newmtl skin\nKd 0.2 0.4 0.8\n{line}")
    pixels = np.zeros((8, 8, 3), np.uint8)
    pixels[:4], pixels[4:] = (0, 255, 0), (255, 0, 0)
    Image.fromarray(pixels).save(folder / "skin.png")
    return folder / "box.obj"


def assert_stands(mesh):
    """On z = 0, its footprint centred."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    assert low[2] == pytest.approx(0, abs=1e-6)
    assert (low + high)[:2] == pytest.approx([0, 0], abs=1e-6)


def color_at(mesh, corner):
    """Texture colours (N, 3) at corners of faces."""
    height, width = mesh.texture.shape[:2]
    uv = mesh.corner_uvs[corner]
    x = np.clip((uv[..., 0] * width).astype(int), 0, width - 1)
    y = np.clip((uv[..., 1] * height).astype(int), 0, height - 1)
    return mesh.texture[y, x]


def test_obj_with_texture(tmp_path):
    model = load_model(write_obj(tmp_path))
    mesh = model.mesh
    assert model.name == "box"
    assert mesh.extent_m == pytest.approx([0.2, 0.1, 0.3])
    assert_stands(mesh)
    assert len(mesh.faces) == 6
    assert mesh.vertices.dtype == np.float32
    assert mesh.faces.dtype == np.int32
    assert mesh.corner_uvs.dtype == np.float32
    assert mesh.corner_normals.shape == (6, 3, 3)
    # vt (1, 1) is the picture's top, which is green; vt (0, 0) its bottom, red.
    top = np.flatnonzero(mesh.vertices[:, 2] > 0.29)
    face, corner = np.nonzero(np.isin(mesh.faces, top))
    assert (color_at(mesh, (face, corner)) == [0, 255, 0]).all()
    below = mesh.faces[face[0]].tolist().index(next(v for v in mesh.faces[face[0]] if v not in top))
    assert color_at(mesh, (face[0], below)).tolist() == [255, 0, 0]


def test_faces_look_outwards(tmp_path):
    mesh = load_model(write_obj(tmp_path)).mesh
    corners = mesh.vertices[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = corners.mean(axis=1) - mesh.vertices.mean(axis=0)
    assert ((normal * outwards).sum(axis=1) > 0).all()


def test_up_axis_and_unit_can_be_given(tmp_path):
    path = write_obj(tmp_path)
    mesh = load_model(path, "tent", up="y", unit_m=2.0).mesh
    assert mesh.extent_m == pytest.approx([0.4, 0.6, 0.2])
    assert_stands(mesh)


def test_missing_texture_warns_and_falls_back_to_the_colour(tmp_path):
    path = write_obj(tmp_path, "lost.png")
    with pytest.warns(UserWarning, match=r"lost\.png.*one colour"):
        mesh = load_model(path).mesh
    assert np.abs(mesh.texture[0, 0].astype(int) - [51, 102, 204]).max() <= 1


def test_glb_merges_nodes_and_turns_y_up(tmp_path):
    scene = trimesh.Scene()
    red, blue = (
        trimesh.visual.TextureVisuals(
            material=trimesh.visual.material.PBRMaterial(baseColorFactor=color)
        )
        for color in ([255, 0, 0, 255], [0, 0, 255, 255])
    )
    low, high = trimesh.creation.box([0.2, 0.1, 0.4]), trimesh.creation.box([1.0, 1.0, 1.0])
    low.visual, high.visual = red, blue
    scene.add_geometry(low)
    scaled = np.diag([0.1, 0.1, 0.1, 1.0])
    scaled[:3, 3] = [0, 0.15, 0]  # y is up
    scene.add_geometry(high, transform=scaled)
    (tmp_path / "two.glb").write_bytes(scene.export(file_type="glb"))
    mesh = load_model(tmp_path / "two.glb").mesh
    assert mesh.extent_m == pytest.approx([0.2, 0.4, 0.25], abs=1e-5)
    assert_stands(mesh)
    height = mesh.vertices[mesh.faces].mean(axis=1)[:, 2]
    colors = color_at(mesh, (np.arange(len(mesh.faces)), 0))
    assert (colors[height > 0.11] == [0, 0, 255]).all()
    assert (colors[height < 0.09] == [255, 0, 0]).all()


def test_mirrored_nodes_still_look_outwards(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box([0.2, 0.1, 0.4]), transform=np.diag([-1.0, 1, 1, 1]))
    (tmp_path / "m.glb").write_bytes(scene.export(file_type="glb"))
    mesh = load_model(tmp_path / "m.glb").mesh
    corners = mesh.vertices[mesh.faces].astype(float)
    assert np.einsum("fi,fi->", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2]) > 0


def test_ply_vertex_colours_become_a_texture(tmp_path):
    box = trimesh.creation.box([0.1, 0.1, 0.2])
    colors = np.where(box.vertices[:, 2:] > 0, [250, 10, 10], [10, 10, 250]).astype(np.uint8)
    box.visual = trimesh.visual.ColorVisuals(box, vertex_colors=colors)
    (tmp_path / "b.ply").write_bytes(box.export(file_type="ply"))
    mesh = load_model(tmp_path / "b.ply").mesh
    upper = mesh.vertices[mesh.faces][..., 2] > 0.1
    found = color_at(mesh, np.nonzero(np.ones(mesh.faces.shape))).reshape(-1, 3, 3)
    assert (found[upper] == [250, 10, 10]).all()
    assert (found[~upper] == [10, 10, 250]).all()


DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2020-01-01T00:00:00Z</created><modified>2020-01-01T00:00:00Z</modified>
<unit name="unit" meter="{meter}"/><up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="g" name="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 20 0 0 0 10 0 0 0 30</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/>
<p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><scale>1 2 1</scale>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""


@pytest.mark.parametrize(
    ("up", "extent_m"),
    [("Z_UP", [0.2, 0.2, 0.3]), ("Y_UP", [0.2, 0.3, 0.2]), ("X_UP", [0.3, 0.2, 0.2])],
)
def test_dae_heeds_unit_axis_and_nodes(tmp_path, up, extent_m):
    path = tmp_path / "t.dae"
    path.write_text(DAE.format(meter=0.01, up=up))
    mesh = load_model(path).mesh
    assert mesh.extent_m == pytest.approx(extent_m, abs=1e-6)
    assert_stands(mesh)


def write_gazebo(
    folder: Path, pose="0 0 0 0 0 0", scale="1 1 1", uri=None, sdf_name="model.sdf"
) -> Path:
    """A Gazebo model; its mesh says y is up, which Gazebo does not heed."""
    (folder / "meshes").mkdir(parents=True)
    (folder / "meshes/t.dae").write_text(DAE.format(meter=0.01, up="Y_UP"))
    (folder / "model.config").write_text(
        f'<model><name>x</name><sdf version="1.4">none.sdf</sdf>'
        f'<sdf version="1.10">{sdf_name}</sdf></model>'
    )
    uri = uri or f"model://{folder.name}/meshes/t.dae"
    (folder / "model.sdf").write_text(
        f"<sdf><model><link><pose>0 0 1 0 0 0</pose><visual name='a'><pose>{pose}</pose><geometry>"
        f"<mesh><uri>{uri}</uri><scale>{scale}</scale></mesh></geometry></visual></link></model></sdf>"
    )
    return folder


def test_gazebo_folder(tmp_path):
    model = load_model(write_gazebo(tmp_path / "cone"))
    assert model.name == "cone"
    assert model.mesh.extent_m == pytest.approx([0.2, 0.2, 0.3], abs=1e-6)
    assert_stands(model.mesh)


def test_gazebo_scale_and_pose(tmp_path):
    folder = write_gazebo(tmp_path / "cone", pose="0 0 0 1.5707963 0 0", scale="1 1 2")
    assert load_model(folder).mesh.extent_m == pytest.approx([0.2, 0.6, 0.2], abs=1e-6)
    moved = tmp_path / "renamed"
    folder.rename(moved)
    assert load_model(moved, "n").name == "n"


def test_gazebo_shapes_with_colours(tmp_path):
    (tmp_path / "model.sdf").write_text(
        "<sdf><model><link>"
        "<visual><geometry><box><size>0.2 0.3 0.1</size></box></geometry>"
        "<material><diffuse>1 0 0 1</diffuse></material></visual>"
        "<visual><pose>0 0 0.1 0 0 0</pose><geometry><cylinder><radius>0.05</radius>"
        "<length>0.1</length></cylinder></geometry></visual>"
        "</link></model></sdf>"
    )
    mesh = load_model(tmp_path).mesh
    assert mesh.extent_m == pytest.approx([0.2, 0.3, 0.2], abs=1e-6)
    assert color_at(mesh, (0, 0)).tolist() == [255, 0, 0]


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda f: f / "none.obj", r"none\.obj: no such mesh file"),
        (lambda f: write_gazebo(f / "a", uri="model://a/meshes/b.dae"), r"b\.dae: no such mesh"),
        (lambda f: write_gazebo(f / "a", sdf_name="q.sdf"), r"names 'q\.sdf', which is not"),
        (lambda f: write_gazebo(f / "a", pose="1 2"), "expected 6 numbers, found '1 2'"),
        (lambda f: write_gazebo(f / "a", scale="0.001 0.001 0.001"), "Is its unit another"),
        (lambda f: write_gazebo(f / "a", scale="1000 1000 1000"), "Is its unit another"),
    ],
)
def test_errors_are_one_line(tmp_path, make, match):
    with pytest.raises(DataError, match=match) as caught:
        load_model(make(tmp_path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content", "match"),
    [
        ("a.glb", b"glTF" + struct.pack("<II", 2, 12) + b"xx", "damaged mesh"),
        ("a.dae", b"<COLLADA", "damaged mesh"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\n", "no faces|damaged"),
        ("a.xyz", b"", "expected one of"),
    ],
)
def test_damaged_files(tmp_path, name, content, match):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DataError, match=match) as caught:
        load_model(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_folder_of_models(tmp_path):
    write_gazebo(tmp_path / "b_cone")
    write_obj(tmp_path / "a_tent")
    write_obj(tmp_path)
    (tmp_path / "notes").mkdir()
    assert [m.name for m in load_models(tmp_path)] == ["a_tent", "b_cone", "box"]
    write_obj(tmp_path / "cup" / "blue")
    write_obj(tmp_path / "cup" / "red")
    cups = [m for m in load_models(tmp_path) if m.name == "cup"]
    assert [m.instance for m in cups] == ["cup_blue", "cup_red"]
    (tmp_path / "b_cone.obj").write_text(OBJ)
    with pytest.raises(DataError, match="two object models are called 'b_cone'"):
        load_models(tmp_path)
    with pytest.raises(DataError, match="no object models"):
        load_models(tmp_path / "notes")
    with pytest.raises(DataError, match="no such folder"):
        load_models(tmp_path / "gone")


def test_atlas_keeps_every_texture_within_its_place():
    sizes = [(900, 700), (600, 600), (20, 300), (4, 4)]
    images = [np.full((*size, 3), 40 * (i + 1), np.uint8) for i, size in enumerate(sizes)]
    atlas = make_atlas(images)
    assert max(atlas.texture.shape) <= 1024
    for i in range(len(images)):
        uv = atlas.move(i, np.array([[0, 0], [0.5, 0.5], [0.999, 0.999]], np.float32))
        x, y = (uv * atlas.texture.shape[1::-1]).astype(int).T
        assert (atlas.texture[y, x] == 40 * (i + 1)).all()


def test_repeating_textures_are_written_out():
    image = np.array([[[1, 1, 1], [2, 2, 2]]], np.uint8)
    tiled, uvs = unrepeat(image, np.array([[[-1, 0], [1, 0], [1, 1]]], np.float32))
    assert tiled[0, :, 0].tolist() == [1, 2, 1, 2]
    assert uvs[0, :, 0].tolist() == [0, 1, 1]


def test_corner_colours_blend():
    colors = np.array([[[0, 0, 0], [100, 0, 0], [0, 200, 0]]], np.uint8)
    texture, uvs = texture_of_corner_colors(colors)
    side = texture.shape[0]
    x, y = np.floor(uvs[0] * side).astype(int).T
    assert texture[y, x].tolist() == colors[0].tolist()
    assert texture[0, side // 2, 0] in range(40, 70)


def test_normals_keep_creases_and_smooth_the_rest():
    box, ball = trimesh.creation.box(), trimesh.creation.icosphere(3)
    flat = corner_normals(box.vertices, box.faces)
    assert np.allclose(flat, box.face_normals[:, None], atol=1e-6)
    smooth = corner_normals(ball.vertices, ball.faces)
    assert np.allclose(smooth, ball.vertices[ball.faces], atol=0.02)
    vertices, number = weld(np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 0]]))
    assert len(vertices) == 2
    assert number[0] == number[2] != number[1]


@pytest.mark.parametrize("missing", ["collada", "trimesh"])
def test_models_without_their_reader_name_the_extra(tmp_path, monkeypatch, missing):
    path = tmp_path / "t.dae"
    path.write_text(DAE.format(meter=0.01, up="Y_UP"))
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(ConfigError, match=r"t\.dae: .* pip install 'imodbatch\[lab\]'$"):
        load_model(path)


@pytest.mark.skipif(not SCANS.is_dir(), reason="IMODBATCH_DATA has no gazebo_models")
def test_real_scans_have_plausible_sizes_and_textures():
    sizes_m = {
        "ycb_003_cracker_box": (0.06, 0.16, 0.21),
        "ycb_005_tomato_soup_can": (0.068, 0.068, 0.102),
        "ycb_077_rubiks_cube": (0.057, 0.057, 0.057),
    }
    for name, size_m in sizes_m.items():
        model = load_model(SCANS / name)
        assert model.mesh.extent_m == pytest.approx(size_m, abs=0.02), name
        assert_stands(model.mesh)
        picture = render_view(model, 0.3, 0.4, 96)
        shown = picture[picture[..., 3] == 255][:, :3]
        assert shown.mean() > 40
        assert shown.std() > 25
