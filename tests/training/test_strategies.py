"""tf.distribute strategies by name: what multiworker needs."""

import json

import pytest
import tensorflow as tf

from common.errors import InputError
from training.strategies import make_strategy

TASK = {"type": "worker", "index": 0}


def test_multiworker_needs_tf_config(monkeypatch):
    monkeypatch.delenv("TF_CONFIG", raising=False)
    with pytest.raises(InputError, match="TF_CONFIG"):
        make_strategy("multiworker")


@pytest.mark.parametrize(
    "config",
    [
        "{",
        5,
        {},
        {"cluster": {"worker": "localhost:4001"}, "task": TASK},
        {"cluster": {"worker": ["nonsense"]}, "task": TASK},
        {"cluster": {"worker": ["localhost:port"]}, "task": TASK},
        {"cluster": {"worker": ["localhost:99999"]}, "task": TASK},
        {"cluster": {"worker": [4001]}, "task": TASK},
        {"cluster": {"worker": []}, "task": TASK},
        {"cluster": {"worker": {"0": "localhost:4001"}}, "task": TASK},
        {"cluster": ["localhost:4001"], "task": TASK},
        {"cluster": {"worker": ["localhost:4001"], "ps": 3}, "task": TASK},
        {"cluster": {"worker": ["localhost:4001"]}, "task": {"type": "worker", "index": 1}},
        {"cluster": {"worker": ["localhost:4001"]}, "task": {"type": "worker", "index": "x"}},
        {"cluster": {"worker": ["localhost:4001"]}, "task": [0]},
    ],
    ids=str,
)
def test_a_malformed_tf_config_is_one_line(monkeypatch, config):
    text = config if isinstance(config, str) else json.dumps(config)
    monkeypatch.setenv("TF_CONFIG", text)
    with pytest.raises(InputError, match="multiworker needs TF_CONFIG: "):
        make_strategy("multiworker")


def test_an_address_that_cannot_be_served_is_one_line(monkeypatch):
    def failed():
        raise tf.errors.UnknownError(None, None, "Could not start gRPC server")

    config = {"cluster": {"worker": ["localhost:4001"]}, "task": TASK}
    monkeypatch.setenv("TF_CONFIG", json.dumps(config))
    monkeypatch.setattr(tf.distribute, "MultiWorkerMirroredStrategy", failed)
    with pytest.raises(InputError, match="by TF_CONFIG: Could not start gRPC server"):
        make_strategy("multiworker")
