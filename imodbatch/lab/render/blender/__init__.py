"""The renderer of the paper: Blender's Cycles, path traced on the CPU.

Blender is never loaded into this process. It is another program, which gets a folder with a mesh, a
texture and a list of views, and leaves the light of every view there:

    views           `render_views`: an object and its views → pictures
    request         what is written for Blender, and how its light is read back
    program         which interpreter or program runs, and what is said when there is none
    cycles_script   runs inside Blender; knows nothing of this package

Cameras and the tone curve are the ray caster's, so both renderers' pictures carry the same labels.
"""

from imodbatch.lab.render.blender.program import PROGRAM_VARIABLE
from imodbatch.lab.render.blender.views import VERSION, render_views

__all__ = ["PROGRAM_VARIABLE", "VERSION", "render_views"]
