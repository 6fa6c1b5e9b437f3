"""VGG-16 features of a file in torchvision's layout, and rejected files."""

from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.dynamics.strokes.photometry import linear_to_srgb
from pentimento.semantics.style import StyleObjective
from pentimento.semantics.vgg import load_vgg16

CHANNELS = (64, 64, "M", 128, 128, "M", 256, 256, 256, "M", 512, 512, 512, "M", 512, 512, 512, "M")


def published_layout() -> nn.Sequential:
    """VGG-16's convolutions as the paper's column D and torchvision's order have them, at random."""
    layers: list[nn.Module] = []
    before = 3
    for entry in CHANNELS:
        if isinstance(entry, str):
            layers.append(nn.MaxPool2d(2, 2))
        else:
            layers += [nn.Conv2d(before, entry, 3, padding=1), nn.ReLU()]
            before = entry
    return nn.Sequential(*layers)


@pytest.fixture(scope="module")
def network() -> nn.Sequential:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return published_layout().requires_grad_(False)


@pytest.fixture(scope="module")
def weights(network: nn.Sequential, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("vgg") / "vgg16.pth"
    state = {f"features.{name}": tensor for name, tensor in network.state_dict().items()}
    torch.save(state | {"classifier.6.bias": torch.zeros(1000)}, path)
    return path


def image(seed: int) -> Tensor:
    return torch.rand(48, 32, 3, generator=torch.Generator().manual_seed(seed))


def test_vgg_features_are_the_networks_activations(network: nn.Sequential, weights: Path) -> None:
    cells = load_vgg16(weights)(image(0))
    assert cells.shape == (3 * 2, 3 + 64 + 128 + 256 + 512)
    srgb = linear_to_srgb(image(0).movedim(-1, 0))
    torch.testing.assert_close(cells[0, :3], srgb[:, :16, :16].mean((1, 2)))
    mean, spread = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    activation = ((srgb - mean[:, None, None]) / spread[:, None, None])[None]
    first = 3
    for index, layer in enumerate(network):
        activation = layer(activation)
        if index in (3, 8, 15, 22):  # relu1_2, relu2_2, relu3_3, relu4_3
            side = activation.shape[-1] // 2
            lower_right = activation[0, :, 2 * side :, side:].mean((1, 2))
            last = first + len(lower_right)
            torch.testing.assert_close(cells[5, first:last], lower_right / lower_right.norm(), rtol=1e-3, atol=1e-4)
            first = last


def test_style_objective_decreases_along_its_gradient_through_vgg(weights: Path) -> None:
    objective = StyleObjective(image(0), load_vgg16(weights), 0)
    assert float(objective(image(0))) == 0
    start = (image(1) ** 3).requires_grad_(True)
    value = objective(start)
    value.backward()
    assert start.grad is not None
    with torch.no_grad():
        lower = objective(start - 1e-2 * start.grad / start.grad.norm())
    assert float(lower) < float(value.detach())


def test_rejects_missing_vgg_weights(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no VGG-16 weights at .*nowhere\.pth: .*local features"):
        load_vgg16(tmp_path / "nowhere.pth")


def test_rejects_vgg_files_that_are_no_state_dict(tmp_path: Path) -> None:
    broken = tmp_path / "broken.pth"
    for content in (b"", b"not a pickle", b"PK\x03\x04 cut off"):
        broken.write_bytes(content)
        with pytest.raises(ContractError, match=r"broken\.pth is not a file of tensors"):
            load_vgg16(broken)
    torch.save([torch.zeros(3)], broken)
    with pytest.raises(ContractError, match=r"broken\.pth holds list, not a state dict"):
        load_vgg16(broken)


class Malice:
    """Unpickled without care, it would write a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[Path]]:
        return Path.touch, (self.path,)


def test_vgg_file_with_code_is_rejected_and_not_executed(tmp_path: Path) -> None:
    torch.save({"features.0.weight": Malice(tmp_path / "written")}, tmp_path / "evil.pth")
    with pytest.raises(ContractError, match=r"evil\.pth is not a file of tensors"):
        load_vgg16(tmp_path / "evil.pth")
    assert not (tmp_path / "written").exists()


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        (None, r"has no tensor 'features\.5\.weight'"),
        (torch.zeros(128, 64, 5, 5), r"features\.5\.weight has shape \(128, 64, 5, 5\), VGG-16 has \(128, 64, 3, 3\)"),
        (torch.full((128, 64, 3, 3), torch.nan), r"features\.5\.weight is not finite"),
    ],
)
def test_rejects_vgg_state_dict_of_another_layout(
    network: nn.Sequential, tmp_path: Path, entry: Tensor | None, sentence: str
) -> None:
    state: dict[str, object] = {f"features.{name}": tensor for name, tensor in network[:24].state_dict().items()}
    torch.save(state | {"features.5.weight": entry}, tmp_path / "other.pth")
    with pytest.raises(ContractError, match=sentence):
        load_vgg16(tmp_path / "other.pth")
