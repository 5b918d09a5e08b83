"""Seventeen household objects made by procedures: shapes, paint, and a catalogue of both."""

from imodbatch.lab.objects.catalogue import OBJECTS, load_object

__all__ = ["OBJECTS", "load_object"]
