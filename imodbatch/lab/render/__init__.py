"""Pictures of meshes, by two renderers that mean the same by a view.

raycast  rays through open3d's embree, shaded in numpy: whole frames and single objects, fast
blender  path tracing through Blender's Cycles: single objects, slow
"""
