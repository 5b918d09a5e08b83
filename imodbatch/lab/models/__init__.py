"""Users' own object models: scans and meshes from files, made ready to be rendered.

A Gazebo model folder, GLB, OBJ + MTL, DAE or PLY becomes one `ObjectModel`: all parts under their
node transforms, all textures in one atlas, in metres, standing on z = 0 with its footprint centred.

    loading   `load_model`, `load_models`: which file, which axis is up, is its size plausible
    gazebo    model.config → sdf → visuals with their poses, scales and colours
    parts     what trimesh read → triangles with a texture each
    atlas     many textures → one
    normals   smooth shading that keeps creases
"""

from imodbatch.lab.models.loading import load_model, load_models

__all__ = ["load_model", "load_models"]
