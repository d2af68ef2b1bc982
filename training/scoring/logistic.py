"""Logistic regression with standardised inputs and an L2 penalty, fitted by L-BFGS.

Letters: S samples, F features.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

LEAST_SCALE = 1e-3  # of a feature that hardly varies


class LogisticModel(NamedTuple):
    """logit = (x - mean) / scale @ weight + bias."""

    mean: np.ndarray  # (F,)
    scale: np.ndarray  # (F,)
    weight: np.ndarray  # (F,)
    bias: float

    def probability(self, x: np.ndarray) -> np.ndarray:
        """(S, F) -> (S,)."""
        return expit((x - self.mean) / self.scale @ self.weight + self.bias)


def fit_logistic(
    x: np.ndarray, y: np.ndarray, sample_weight: np.ndarray, penalty: np.ndarray
) -> LogisticModel:
    """Minimises the weighted mean log loss + sum(penalty * weight^2) / 2.

    Args:
        x: (S, F). y: (S,) bool. sample_weight: (S,) non-negative. penalty: (F,) positive.
    """
    share = sample_weight / sample_weight.sum()
    mean = share @ x
    scale = np.maximum(np.sqrt(share @ (x - mean) ** 2), LEAST_SCALE)
    z, sign = (x - mean) / scale, np.where(y, -1.0, 1.0)

    def loss(theta: np.ndarray) -> tuple[float, np.ndarray]:
        weight, logit = theta[:-1], z @ theta[:-1] + theta[-1]
        residual = share * (expit(logit) - y)
        value = share @ np.logaddexp(0, sign * logit) + penalty @ weight**2 / 2
        return value, np.append(residual @ z + penalty * weight, residual.sum())

    theta = minimize(loss, np.zeros(x.shape[1] + 1), jac=True, method="L-BFGS-B").x
    return LogisticModel(mean, scale, theta[:-1], float(theta[-1]))


def log_loss(probability: np.ndarray, y: np.ndarray) -> float:
    """Mean negative log likelihood of y (S,) bool."""
    return float(-np.log(np.maximum(np.where(y, probability, 1 - probability), 1e-12)).mean())
