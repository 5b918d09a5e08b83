"""Commands that make data and detectors: simulate, synth, train.

They join `imodbatch` by entry point. Heavy libraries load inside the commands.
"""

from imodbatch.lab.commands.simulate import simulate
from imodbatch.lab.commands.synth import synth
from imodbatch.lab.commands.train import train

__all__ = ["simulate", "synth", "train"]
