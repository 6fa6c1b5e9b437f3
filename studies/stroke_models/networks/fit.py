"""Train networks of coverage on the thesis's weighted L1, by the loop that trains Traj2Stroke."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d

from pentimento.dynamics.strokes.evaluation import weighted_l1
from pentimento.dynamics.strokes.samples import StrokeSamples
from pentimento.dynamics.strokes.training import Log, TrainingConfig, descend, split_by_action
from pentimento.dynamics.strokes.traj2stroke import Traj2Stroke
from studies.stroke_models.networks import param2stroke, trajectory_cnn
from studies.stroke_models.networks.coverage import CoverageModel, laid, press_range
from studies.stroke_models.networks.frame import Crop, crop_around
from studies.stroke_models.networks.param2stroke import Param2Stroke
from studies.stroke_models.networks.path_image import PathImageCnn
from studies.stroke_models.networks.refined import RefinedTraj2Stroke
from studies.stroke_models.networks.trajectory_cnn import TrajectoryCnn

Model = TypeVar("Model", bound=CoverageModel)
AnyNetwork = TypeVar("AnyNetwork", bound=nn.Module)

_COARSE_SHARE, _BLUR_PX = 0.4, 9


@dataclass(frozen=True)
class Setting:
    """What a network is made for, beside the strokes that it learns from."""

    asked_path: Tensor
    """[B, N, 5]: commands that it will be asked for; a network with a fixed crop has room for them."""
    margin_m: float
    """Around commanded paths, in the stroke's frame."""
    config: TrainingConfig
    """``held_out`` is the share of the training actions that decides which epoch is taken."""


def fit_param2stroke(samples: StrokeSamples, setting: Setting, log: Log) -> Param2Stroke:
    """Thesis 4.3.2."""
    torch.manual_seed(setting.config.seed)
    crop = _crop(samples, setting, param2stroke.COARSER)
    return train_network(Param2Stroke(crop, press_range(samples.path)), samples, setting.config, log)


def fit_trajectory_cnn(samples: StrokeSamples, setting: Setting, coordinates: bool, log: Log) -> TrajectoryCnn:
    """Thesis 5.4.3; ``coordinates``: with CoordConv."""
    torch.manual_seed(setting.config.seed)
    crop = _crop(samples, setting, trajectory_cnn.COARSER)
    network = TrajectoryCnn(crop, press_range(samples.path), samples.path.shape[1], coordinates)
    return train_network(network, samples, setting.config, log)


def fit_path_image_cnn(samples: StrokeSamples, setting: Setting, log: Log) -> PathImageCnn:
    """A U-Net on pictures of paths."""
    torch.manual_seed(setting.config.seed)
    network = PathImageCnn(press_range(samples.path), setting.margin_m, float(setting.config.pixels_per_m))
    return train_network(network, samples, setting.config, log)


def fit_refined(base: Traj2Stroke, samples: StrokeSamples, setting: Setting, log: Log) -> RefinedTraj2Stroke:
    """The second half of training Traj2Stroke with a U-Net (thesis 5.4.3): both learn.

    In the first half the U-Net is frozen and, its last convolution being zero, does nothing: that half is the training
    of ``base`` alone, which is copied and stays as it is.
    """
    torch.manual_seed(setting.config.seed)
    copied = Traj2Stroke(base.parameters_si())
    network = RefinedTraj2Stroke(copied, setting.margin_m, float(setting.config.pixels_per_m))
    return train_network(network, samples, setting.config, log)


def train_network(network: Model, samples: StrokeSamples, config: TrainingConfig, log: Log) -> Model:
    """Lower the weighted L1; the epoch with the lowest validation loss is taken, the untrained one included.

    A network that draws from numbers alone begins on blurred photographs, for two fifths of the epochs: a thin line
    that it draws beside its place does not overlap it, and L1 would have it draw none.

    ``log`` gets ``weighted_l1`` and ``validation_l1`` after every epoch.
    """
    training, validation = split_by_action(samples, config.held_out, config.seed)
    best = _Best(network, lambda: laid(network(validation), validation), validation, config.ink_weight, log)

    def predict(index: Tensor) -> Tensor:
        some = training.pick(index)
        return laid(network(some), some)

    sharp = config.epochs
    if network.draws_from_numbers:
        coarse = round(_COARSE_SHARE * config.epochs)
        sharp -= coarse
        hazy = training._replace(after=_blurred(training.after))
        descend(network, lambda index: _blurred(predict(index)), hazy, config=replace(config, epochs=coarse), log=log)
    descend(network, predict, training, config=replace(config, epochs=sharp), log=log, after_epoch=best.after_epoch)
    return best.taken()


def predicted(network: Callable[[StrokeSamples], Tensor], samples: StrokeSamples) -> Tensor:
    """The photographs that a trained network predicts, sRGB [B, H, W, 3]."""
    with torch.no_grad():
        return laid(network(samples), samples)


class _Best(Generic[AnyNetwork]):
    """A network's state after the epoch with the lowest validation loss, the untrained one included."""

    def __init__(
        self, network: AnyNetwork, predict: Callable[[], Tensor], samples: StrokeSamples, ink_weight: float, log: Log
    ) -> None:
        self.network, self.predict, self.samples, self.ink_weight, self.log = (
            network, predict, samples, ink_weight, log,
        )  # fmt: skip
        self.minimum, self.state = self._validation_loss(), self._copied()

    def after_epoch(self, epoch: int) -> None:
        now = self._validation_loss()
        self.log("validation_l1", now, epoch)
        if now < self.minimum:
            self.minimum, self.state = now, self._copied()

    def taken(self) -> AnyNetwork:
        self.network.load_state_dict(self.state)
        return self.network.eval()

    def _validation_loss(self) -> float:
        learning = self.network.training
        self.network.eval()
        with torch.no_grad():
            now = float(weighted_l1(self.predict(), self.samples, self.ink_weight))
        self.network.train(learning)
        return now

    def _copied(self) -> dict[str, Tensor]:
        return {name: value.clone() for name, value in self.network.state_dict().items()}


def _blurred(images: Tensor) -> Tensor:
    """Means over squares of photographs [B, H, W, 3]."""
    channels = images.permute(0, 3, 1, 2)
    mean = avg_pool2d(channels, _BLUR_PX, 1, _BLUR_PX // 2, count_include_pad=False)
    return mean.permute(0, 2, 3, 1)


def _crop(samples: StrokeSamples, setting: Setting, multiple: int) -> Crop:
    paths = torch.cat([samples.path, setting.asked_path])
    return crop_around(paths, setting.margin_m, float(setting.config.pixels_per_m), multiple)
