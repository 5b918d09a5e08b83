"""A family: detectors of one training in one file, each as it was to the bit."""

from pathlib import Path

import pytest
import torch
from detectors import LIGHT, load_network
from safetensors.torch import load_file, save_file

from imodbatch.core.errors import ConfigError
from imodbatch.detection.card import DetectorCard, Family
from imodbatch.detection.checkpoint import save_checkpoint, stored_tensors
from imodbatch.detection.files import checkpoint_files, read_card, read_checkpoint, write_card
from imodbatch.detection.heads import build_head
from imodbatch.detection.network import build_detector
from imodbatch.lab.learning.family import join_family

SMALL = LIGHT.model_copy(update={"fpn_channels": 8, "head_width": 16})


def make_card(name: str, n_azimuths: int) -> DetectorCard:
    return DetectorCard(
        format_version=1,
        name=name,
        architecture=SMALL,
        classes=("cup", "jug"),
        n_azimuths=n_azimuths,
        elevations_deg=(30.0,) if n_azimuths > 1 else (),
        image_size=(128, 96),
        licence="CC0-1.0",
        data={},
        seed=0,
        figures={"unknown": None},
    )


@pytest.fixture
def members(tmp_path: Path) -> list[Path]:
    """Two detectors that share all but the score head, as one training leaves them."""
    torch.manual_seed(3)
    card = make_card("eight", 8)
    network = build_detector(card)
    paths = [tmp_path / "eight.safetensors", tmp_path / "none.safetensors"]
    save_checkpoint(network, card, paths[0])
    other = make_card("none", 1)
    network.head = build_head(other)
    save_checkpoint(network, other, paths[1])
    return paths


@pytest.fixture
def cards(members: list[Path], tmp_path: Path) -> list[Path]:
    (tmp_path / "family").mkdir()
    return join_family(members, tmp_path / "family" / "both.safetensors")


def bits(path: Path) -> dict[str, tuple[str, tuple[int, ...], bytes]]:
    tensors = stored_tensors(read_checkpoint(path))
    return {n: (str(t.dtype), tuple(t.shape), t.numpy().tobytes()) for n, t in tensors.items()}


def test_members_are_as_they_were_to_the_bit(members: list[Path], cards: list[Path]) -> None:
    assert [path.name for path in cards] == ["eight.json", "none.json"]
    for alone, card in zip(members, cards, strict=True):
        assert bits(card) == bits(alone)
        assert load_network(card)[1].figures == {"unknown": None}
        assert "family" not in alone.with_suffix(".json").read_text(encoding="utf-8")
    stored = load_file(cards[0].with_name("both.safetensors"))
    heads = {name for name in stored if "/" in name}
    assert {name.split("/")[1].split(".")[0] for name in heads} == {"head"}
    assert len(stored) - len(heads) > 100
    assert sum(tensor.nbytes for tensor in stored.values()) < 1.1 * members[0].stat().st_size


def test_a_member_goes_by_its_card_or_by_the_weights_it_would_have(cards: list[Path]) -> None:
    expected = (cards[0].with_name("both.safetensors"), cards[0])
    assert checkpoint_files(cards[0]) == expected
    assert checkpoint_files(cards[0].with_suffix(".safetensors")) == expected


def test_joining_again_gives_the_same_bytes(cards: list[Path], tmp_path: Path) -> None:
    file = cards[0].with_name("both.safetensors")
    (tmp_path / "again").mkdir()
    join_family(cards, tmp_path / "again" / "both.safetensors")
    assert (tmp_path / "again" / "both.safetensors").read_bytes() == file.read_bytes()


def test_the_digest_covers_card_and_tensors(cards: list[Path]) -> None:
    digests = [read_checkpoint(card).digest for card in cards]
    assert len(set(digests)) == 2
    write_card(read_card(cards[0]).model_copy(update={"licence": "other"}), cards[0])
    assert read_checkpoint(cards[0]).digest != digests[0]
    assert read_checkpoint(cards[1]).digest == digests[1]
    file = cards[0].with_name("both.safetensors")
    tensors = load_file(file)
    tensors["none/head.class_logits.bias"] += 1
    save_file(tensors, file)
    assert read_checkpoint(cards[1]).digest != digests[1]


def test_what_is_alike_but_for_the_sign_of_zero_is_not_shared(
    members: list[Path], tmp_path: Path
) -> None:
    for path, zero in zip(members, (0.0, -0.0), strict=True):
        tensors = load_file(path)
        tensors["box_regressor.bias"] = torch.full((4,), zero, dtype=torch.float16)
        save_file(tensors, path)
    before = [bits(path) for path in members]
    (tmp_path / "family").mkdir()
    cards = join_family(members, tmp_path / "family" / "both.safetensors")
    assert [bits(card) for card in cards] == before


@pytest.mark.parametrize(
    ("names", "file", "said"),
    [
        (("eight",), "both", "two members or more"),
        (("eight", "eight"), "both", "two members or more"),
        (("eight", "none"), "none", "differ from each other and from the file's"),
        (("eight", "alien"), "both", "eight, alien have no tensor in common"),
        (("eight", "missing"), "both", "no such weights file"),
    ],
)
def test_what_is_no_family(
    members: list[Path], tmp_path: Path, names: tuple[str, ...], file: str, said: str
) -> None:
    alien = tmp_path / "alien.safetensors"
    save_file({"other": torch.zeros(1)}, alien)
    write_card(make_card("alien", 1), alien.with_suffix(".json"))
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(ConfigError) as error:
        join_family(
            [members[0].with_name(f"{n}.safetensors") for n in names],
            tmp_path / f"{file}.safetensors",
        )
    assert said in str(error.value)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_family_without_its_file_or_that_member(cards: list[Path]) -> None:
    card = read_card(cards[0])
    stranger = Family(file="both.safetensors", member="stranger")
    write_card(card.model_copy(update={"family": stranger}), cards[0])
    with pytest.raises(ConfigError, match=r"both\.safetensors: .* head\.\S+ is missing"):
        load_network(cards[0])
    cards[0].with_name("both.safetensors").unlink()
    with pytest.raises(ConfigError, match=r"both\.safetensors: there is no such weights file"):
        load_network(cards[1])


@pytest.mark.parametrize("file", ["../both.safetensors", "both.bin", "/a/both.safetensors"])
def test_a_family_lies_beside_its_cards(cards: list[Path], file: str) -> None:
    text = cards[0].read_text(encoding="utf-8").replace("both.safetensors", file)
    cards[0].write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"family\.file: String should match"):
        read_card(cards[0])
