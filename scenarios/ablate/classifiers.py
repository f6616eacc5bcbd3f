"""Training of the classifiers with scikit-learn; what they say of new data is computed where it is used."""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import Any

import numpy as np

from slam.cli import InputError
from slam.se2 import Array
from stitch.alignment.acceptance import AcceptanceClassifier

HIDDEN = 48
"""Units of the hidden layer of `fit_network`."""
RIDGE = 10.0
"""L2 penalty of `fit_network`: of half the squared sum of its weights, beside the sum of the log-losses."""
ITERATIONS = 400
"""Most iterations of L-BFGS in `fit_network`."""
FOLDS = 6
"""Most folds of the cross-validation."""


def require(module: str = "") -> Any:
    """A module of scikit-learn. Raises `InputError` where it is not installed."""
    try:
        return import_module(f"sklearn.{module}" if module else "sklearn")
    except ImportError as error:
        raise InputError("training needs scikit-learn: pip install 'slamstitch[train]'") from error


def fit_logistic(features: Array, positive: np.ndarray, weights: Array | None = None) -> tuple[Array, float]:
    """Weights ``(F,)`` and bias of an L2-penalised logistic regression on ``features (n, F)``."""
    model = require("linear_model").LogisticRegression(C=1.0, tol=1e-8, max_iter=10_000)
    model.fit(features, positive, sample_weight=weights)
    return model.coef_[0], float(model.intercept_[0])


def fit_network(features: Array, positive: np.ndarray, rng: np.random.Generator) -> AcceptanceClassifier:
    """The network of `stitch.alignment.acceptance` for ``features (n, F)``, from a start drawn by ``rng``."""
    network = require("neural_network").MLPClassifier(
        (HIDDEN,),
        activation="tanh",
        solver="lbfgs",
        alpha=RIDGE,
        max_iter=ITERATIONS,
        random_state=int(rng.integers(2**31)),
    )
    mean, scale = features.mean(axis=0), features.std(axis=0) + 1e-3
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", require("exceptions").ConvergenceWarning)  # so many are enough
        network.fit((features - mean) / scale, positive)
    (inner, outer), (offset, bias) = network.coefs_, network.intercepts_
    return AcceptanceClassifier(mean, scale, inner, offset, outer[:, 0], bias[0])


def cross_validate(
    features: Array, positive: np.ndarray, groups: np.ndarray, rng: np.random.Generator
) -> Array:
    """Log-odds ``(n,)`` of every example by a network that was trained on other ``groups (n,)`` only."""
    folds = require("model_selection").GroupKFold(min(FOLDS, len(np.unique(groups))))
    log_odds = np.full(len(positive), np.nan)
    for train, test in folds.split(features, positive, groups):
        log_odds[test] = fit_network(features[train], positive[train], rng).log_odds(features[test])
    return log_odds
