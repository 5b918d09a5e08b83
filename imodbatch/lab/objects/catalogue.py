"""The seventeen objects of the paper, in its order."""

from collections.abc import Callable
from functools import cache

from imodbatch.core.errors import ImodError
from imodbatch.lab.mesh import ObjectModel
from imodbatch.lab.objects import (
    block_house,
    cellphone,
    crockery,
    dolls,
    rail_bridge,
    tableware,
    toys,
)

OBJECTS: dict[str, Callable[[], ObjectModel]] = {
    "ball_pink": toys.ball_pink,
    "building_block_house": block_house.building_block_house,
    "cellphone": cellphone.cellphone,
    "gorilla_doll": dolls.gorilla_doll,
    "kidney_beans_doll": dolls.kidney_beans_doll,
    "lego_green": toys.lego_green,
    "lego_red": toys.lego_red,
    "mouse_doll": dolls.mouse_doll,
    "plastic_cup_yellow": tableware.plastic_cup_yellow,
    "rail_bridge": rail_bridge.rail_bridge,
    "rice_bowl": crockery.rice_bowl,
    "spoon_iron": tableware.spoon_iron,
    "square_bowl": crockery.square_bowl,
    "square_dish": crockery.square_dish,
    "steel_juice": tableware.steel_juice,
    "teacup": crockery.teacup,
    "wood_coaster": tableware.wood_coaster,
}


@cache
def load_object(name: str) -> ObjectModel:
    """An object of the catalogue, made once per process. Its arrays are shared: don't write.

    Args:
        name: a key of `OBJECTS`.

    Raises:
        ImodError: there is no such object.
    """
    if name not in OBJECTS:
        raise ImodError(f"No object is called {name!r}; there are {', '.join(OBJECTS)}.")
    return OBJECTS[name]()
