"""Pictures of meshes: ray casting through open3d, path tracing through Blender."""
