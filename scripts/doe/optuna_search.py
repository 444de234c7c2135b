"""The brake pressure at which the brake grows most, by optuna."""

import sys

import optuna

from brake_fenicsx import prepare, sample
from brake_fenicsx.errors import BrakeError

scene, face, trials = sys.argv[1], sys.argv[2], int(sys.argv[3])
model = prepare(scene)


def growth(trial: optuna.Trial) -> float:
    pressure = trial.suggest_float("pressure", 2e5, 8e5)
    return float(sample(model, {f'loads."{face}".pressure': pressure}).s.real.max())


study = optuna.create_study(direction="maximize", sampler=optuna.samplers.TPESampler(seed=1))
# A brake without equilibrium is a failed trial.
study.optimize(growth, n_trials=trials, catch=(BrakeError,))
print(study.best_params, study.best_value)
