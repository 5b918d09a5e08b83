"""The data dictionary keeps its own rules."""

import re

import pyarrow as pa
import pytest

from imodbatch.tables import schemas
from imodbatch.tables.schemas import DETECTION_KEY, FRAME_KEY, TABLES, TableSpec

SPECS = list(TABLES.values())
DESIGNED = {
    "frames",
    "annotations",
    "poses",
    "detections",
    "observations",
    "fused",
    "objects",
    "matches",
    "metrics",
}
UNITS = ("_m", "_px", "_rad", "_ns", "_percent", "_mm")
WITHOUT_UNIT = {  # pure numbers, and columns whose unit depends on the row or is told in `meaning`
    "background_score",
    "score",
    "iou",
    "value",
    "spread",
    "color_from_depth",
    "view_scores",
    "qw",
    "qx",
    "qy",
    "qz",
}

each = pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)


def floats(dtype):
    return pa.types.is_floating(dtype.value_type if pa.types.is_list(dtype) else dtype)


def test_every_designed_table_is_there():
    assert set(TABLES) >= DESIGNED
    assert all(isinstance(spec, TableSpec) and TABLES[spec.name] is spec for spec in SPECS)


def test_every_spec_of_the_module_is_listed():
    specs = [value for value in vars(schemas).values() if isinstance(value, TableSpec)]
    assert {spec.name for spec in specs} == set(TABLES)
    assert len(specs) == len(TABLES)


@each
def test_the_key_is_made_of_columns_that_are_known(spec):
    fields = {field.name: field for field in spec.schema}
    assert spec.key
    assert len(set(spec.key)) == len(spec.key)
    for name in spec.key:
        assert not fields[name].nullable
        assert not floats(fields[name].type)
        assert not pa.types.is_nested(fields[name].type)


@each
def test_columns_are_unique_and_explained(spec):
    assert len(set(spec.schema.names)) == len(spec.schema.names)
    for field in spec.schema:
        assert re.fullmatch(r"[a-z][a-z0-9_]*", field.name)
        assert field.metadata[b"meaning"].decode().strip()


@each
def test_floats_carry_their_unit(spec):
    for field in spec.schema:
        if floats(field.type):
            assert field.name.endswith(UNITS) or field.name in WITHOUT_UNIT, field.name


@each
def test_suffixes_tell_the_type(spec):
    for field in spec.schema:
        if field.name.endswith(("_index", "_bin", "_ns", "_percent")) or field.name == "class_id":
            assert pa.types.is_integer(field.type), field.name
        if field.name.startswith("is_"):
            assert pa.types.is_boolean(field.type), field.name
        if field.name.startswith("n_"):
            assert pa.types.is_integer(field.type), field.name
            assert not field.nullable, field.name


def test_a_column_has_one_type_everywhere():
    types = {}
    for spec in SPECS:
        for field in spec.schema:
            types.setdefault(field.name, set()).add(field.type)
    assert {name for name, found in types.items() if len(found) > 1} <= {
        "n_cells",  # of a box, 16 bits; of an object, 32
        "n_detections",  # of an object, 32 bits; of a run, 64
    }


def test_keys_are_those_of_their_tables_parents():
    frame, detection = (tuple(c.name for c in key) for key in (FRAME_KEY, DETECTION_KEY))
    assert TABLES["frames"].key == TABLES["poses"].key == TABLES["reference_poses"].key == frame
    assert TABLES["detections"].key == TABLES["observations"].key == detection
    assert TABLES["fused"].key == (*detection, "method", "class_id")
    assert TABLES["matches"].key == (*TABLES["fused"].key, "iou_percent")


def test_only_tables_of_a_whole_run_lack_the_sequence():
    for spec in SPECS:
        assert spec.per_run == ("sequence_id" not in spec.schema.names)
