"""Runs inside Blender: ``request.json`` → the light of every view, ``00000.npy`` and so on.

It needs bpy and numpy and nothing else. `request.py` says what the files hold and has turned all
conventions into Blender's already. A picture is (H, W, 4) float16, top row first: linear RGB
weighted with the coverage, and the coverage.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

try:
    import bpy
    from mathutils import Matrix, Vector
except ImportError:
    sys.exit(3)  # NO_BPY in program.py

SENSOR_MM = 36.0
BRIGHTEST = 6e4
"""What float16 can hold, nearly."""


def main(request: Path) -> None:
    """Render all views of a request into its folder."""
    content = json.loads(request.read_text(encoding="utf-8"))
    folder = request.parent
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    set_up(scene, content["n_samples"])
    add_object(scene, folder, content)
    camera = add_camera(scene)
    suns = [add_sun(scene) for _ in range(max(len(v["suns"]) for v in content["views"]))]
    bottom, top = add_sky(scene)
    for index, view in enumerate(content["views"]):
        point_camera(scene, camera, view)
        set_suns(suns, view["suns"])
        bottom.default_value = (*view["sky"]["from_bottom"], 1)
        top.default_value = (*view["sky"]["from_top"], 1)
        scene.cycles.seed = view["seed"] % (1 << 31)
        np.save(folder / f"{index:05d}.npy", render(scene, folder / "light.exr"))


def set_up(scene: Any, n_samples: int) -> None:
    """Cycles on the CPU, few samples and a denoiser, nothing behind the object."""
    scene.render.engine = "CYCLES"
    scene.render.film_transparent = True
    scene.render.use_persistent_data = True
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.image_settings.color_depth = "32"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = n_samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = True
    cycles.denoiser = "OPENIMAGEDENOISE"
    cycles.denoising_prefilter = "FAST"
    cycles.pixel_filter_type = "BOX"  # alpha is then the share of a pixel, not of its surroundings
    cycles.max_bounces = 4
    cycles.caustics_reflective = cycles.caustics_refractive = False


def add_object(scene: Any, folder: Path, content: Any) -> None:
    """The mesh with its texture and materials, as it lies in the files."""
    arrays = np.load(folder / "mesh.npz")
    mesh = bpy.data.meshes.new("object")
    mesh.from_pydata(arrays["vertices"].tolist(), [], arrays["faces"].tolist())
    mesh.uv_layers.new(name="uv").data.foreach_set("uv", arrays["corner_uvs"].ravel())
    image = bpy.data.images.load(str(folder / "texture.png"))
    for shine in content["materials"]:
        mesh.materials.append(material_of(image, shine, content["does_texture_repeat"]))
    mesh.polygons.foreach_set("material_index", arrays["face_material"])
    is_smooth = "corner_normals" in arrays
    mesh.polygons.foreach_set("use_smooth", np.full(len(arrays["faces"]), is_smooth))
    if is_smooth:
        mesh.normals_split_custom_set(arrays["corner_normals"].reshape(-1, 3).tolist())
    mesh.update()
    scene.collection.objects.link(bpy.data.objects.new("object", mesh))


def material_of(image: Any, shine: Any, does_texture_repeat: bool) -> Any:
    """Paint under varnish; Blender's level of specular is 0.5 for common varnish."""
    material = bpy.data.materials.new("surface")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    principled = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    texture = nodes.new("ShaderNodeTexImage")
    texture.image = image
    texture.extension = "REPEAT" if does_texture_repeat else "EXTEND"
    links.new(texture.outputs["Color"], principled.inputs["Base Color"])
    principled.inputs["Specular IOR Level"].default_value = shine["specular"]
    principled.inputs["Roughness"].default_value = shine["roughness"]
    return material


def add_camera(scene: Any) -> Any:
    """A pinhole camera whose lens is set by `point_camera`."""
    data = bpy.data.cameras.new("camera")
    data.sensor_fit, data.sensor_width = "HORIZONTAL", SENSOR_MM
    data.clip_start, data.clip_end = 1e-3, 1e3
    camera = bpy.data.objects.new("camera", data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    return camera


def point_camera(scene: Any, camera: Any, view: Any) -> None:
    """Place, lens and size of picture of one view."""
    scene.render.resolution_x = scene.render.resolution_y = view["size_px"]
    scene.render.resolution_percentage = 100
    camera.data.lens = SENSOR_MM * view["focal_px"] / view["size_px"]
    camera.matrix_world = Matrix(view["object_from_camera"])


def add_sun(scene: Any) -> Any:
    """A sun that is set by `set_suns`."""
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    scene.collection.objects.link(sun)
    return sun


def set_suns(suns: list[Any], entries: list[Any]) -> None:
    """Direction, strength and width of the suns that shine; the others are put out."""
    for sun in suns[len(entries) :]:
        sun.data.energy = 0
    for sun, entry in zip(suns, entries, strict=False):
        energy = max(entry["irradiance"])
        sun.data.energy = energy
        sun.data.color = [channel / max(energy, 1e-9) for channel in entry["irradiance"]]
        sun.data.angle = entry["angle_rad"]
        turn = Vector(entry["to_sun"]).to_track_quat("Z", "Y")
        sun.matrix_world = turn.to_matrix().to_4x4()


def add_sky(scene: Any) -> tuple[Any, Any]:
    """Light from everywhere that changes with the height; its sockets for bottom and top."""
    world = bpy.data.worlds.new("sky")
    scene.world = world
    world.use_nodes = True
    # A map of where the sky is bright would be made anew for every view, and cost most of its time.
    world.cycles.sampling_method = "NONE"
    nodes, links = world.node_tree.nodes, world.node_tree.links
    direction = nodes.new("ShaderNodeTexCoord")
    axes = nodes.new("ShaderNodeSeparateXYZ")
    height = nodes.new("ShaderNodeMapRange")
    height.inputs["From Min"].default_value = -1
    mix = nodes.new("ShaderNodeMixRGB")
    background = next(node for node in nodes if node.type == "BACKGROUND")
    links.new(direction.outputs["Generated"], axes.inputs[0])
    links.new(axes.outputs["Z"], height.inputs["Value"])
    links.new(height.outputs["Result"], mix.inputs["Fac"])
    links.new(mix.outputs["Color"], background.inputs["Color"])
    return mix.inputs["Color1"], mix.inputs["Color2"]


def render(scene: Any, path: Path) -> np.ndarray:
    """One picture; EXR keeps the light as it is."""
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    light = np.empty((image.size[1], image.size[0], 4), np.float32)
    image.pixels.foreach_get(light.ravel())
    bpy.data.images.remove(image)
    return np.minimum(light[::-1], BRIGHTEST).astype(np.float16)


if __name__ == "__main__":
    main(Path(sys.argv[-1]))
