"""The table of networks. A new one is a module with `PRESETS` and `TRAINING`, and a row here."""

import importlib
import pkgutil
from dataclasses import dataclass, field

PAPER_GAMMAS = (1e4, 1e5, 2e5)  # the paper trains one CP-Net for each


class WeightsError(ValueError):
    """Weights that cannot be had or used: says which, why and what to do."""


@dataclass(frozen=True)
class Network:
    """Where one network's parts are.

    module: has PRESETS, preset -> (class, default config), and TRAINING, preset -> TrainConfig;
    call: what it answers, "detect", "predict" or "solve" as in `qclearn.registration.networks`;
    data: "module:function" that gives (config, folder, quick) -> (training, validation) sets;
    gammas: preset -> weights gamma that it is trained for, one file each.
    """

    module: str
    call: str
    data: str
    gammas: dict = field(default_factory=dict)

    @property
    def presets(self):
        return importlib.import_module(self.module).PRESETS

    @property
    def training(self):
        return importlib.import_module(self.module).TRAINING

    @property
    def draw(self):
        return pkgutil.resolve_name(self.data)


NETWORKS = {
    "ldnet": Network("qclearn.nets.ldnet", "detect", "data_synth.training:ldnet"),
    "cpnet": Network(
        "qclearn.nets.cpnet", "predict", "data_synth.training:cpnet", {"paper": PAPER_GAMMAS}
    ),
    "dbsnet": Network("qclearn.nets.dbsnet", "solve", "data_synth.training:dbsnet"),
}


def network(name):
    """The row of a network; WeightsError for an unknown name."""
    if name not in NETWORKS:
        raise WeightsError(f"no network is called {name!r}; there are {', '.join(NETWORKS)}")
    return NETWORKS[name]


def gamma_fault(name, preset, gamma):
    """A message where a network's preset cannot take this gamma (None: not given), or None."""
    row = NETWORKS.get(name)
    if gamma in (row.gammas.get(preset, (None,)) if row else (None,)):
        return None
    trained = [
        f"preset {preset} of {name} has one weights file for each gamma and needs one of "
        f"{', '.join(f'{value:.0f}' for value in values)}"
        for name, row in NETWORKS.items()
        for preset, values in row.gammas.items()
    ]
    return f"{'; '.join(trained)}; others take none; got {gamma}"
