"""`gfm train`: services as processes, one folder, and going on where it stopped."""

import json
import signal
import time

import pytest

from gfm.cli import main
from gfm.experiments.train import START_TIMEOUT_S

EXPERIMENT = """
env = "point_mass"
learner_steps = {steps}
{more}
[learner]
batch_size = 8
metrics_every = 10
[learner.environment]
horizon = 16
[learner.learning]
policy_hidden = [16, 16]
critic_hidden = [16, 16]
discount = {discount}
[actor]
num_envs = 8
sequence_length = 8
[replay]
capacity_mib = 1
min_size = 16
"""


@pytest.fixture(autouse=True)
def signals():
    """The command takes signals over for the rest of its process, which here is pytest's."""
    kept = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in kept.items():
        signal.signal(number, handler)


def experiment(path, steps=40, discount=0.9, more=""):
    path.write_text(EXPERIMENT.format(steps=steps, discount=discount, more=more))
    return path


def rows(run):
    lines = (run / "progress" / "metrics.jsonl").read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines]


def trained(config, run, *more):
    return main(["train", "--config", str(config), "--out", str(run), *more])


def test_trains_to_the_end_and_goes_on_where_it_stopped(tmp_path, capsys):
    config, run = experiment(tmp_path / "one.toml"), tmp_path / "run"
    assert trained(config, run) == 0
    assert str(run / "checkpoints" / "policy.npz") in capsys.readouterr().out
    assert (run / "checkpoints" / "policy.npz").is_file()
    assert (run / "config.toml").read_text() == config.read_text()
    assert list((run / "progress").glob("events.out.tfevents.*"))
    first = rows(run)[-1]
    assert first["learner_step"] == 40
    assert first["env_steps"] >= 16 * 8
    assert first["life"] == 0

    assert trained(experiment(config, steps=70), run, "--resume") == 0
    last = rows(run)[-1]
    assert last["learner_step"] == 70
    assert last["life"] == 1
    assert last["env_steps"] > first["env_steps"]
    log = (run / "logs" / "learner.log").read_text()
    assert "resumed" in log
    assert "at step 40" in log
    actor = (run / "logs" / "actor-0.log").read_text()
    assert '"seed":1000' in actor
    assert "the run's environment" in actor


def test_a_run_is_not_begun_twice_nor_resumed_with_another_experiment(tmp_path, capsys):
    config, run = experiment(tmp_path / "one.toml"), tmp_path / "run"
    assert trained(config, run, "--resume") == 2
    assert "no run to resume" in capsys.readouterr().err
    run.mkdir()
    (run / "config.toml").write_text(config.read_text())
    assert trained(config, run) == 2
    assert "is there already: give --resume, or another --out" in capsys.readouterr().err
    assert trained(experiment(config, discount=0.8), run, "--resume") == 2
    error = capsys.readouterr().err
    assert "learner.learning.discount is 0.8, was 0.9" in error
    assert error.count("\n") == 1
    assert sorted(path.name for path in run.iterdir()) == ["config.toml"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("point_mass", "maze", "unknown environment 'maze'"),
        ("[replay]", "[reply]", "unknown field `reply`"),
        ("num_envs = 8", "num_envs = 'x'", "table actor: Expected `int`, got `str`"),
        ("batch_size = 8", "batch = 8", "table learner: Object contains unknown field `batch`"),
        ("learner_steps = 40", "", "missing required field `learner_steps`"),
    ],
)
def test_an_experiment_of_no_use_is_one_line(tmp_path, capsys, old, new, message):
    config = experiment(tmp_path / "one.toml")
    config.write_text(config.read_text().replace(old, new))
    began_s = time.monotonic()
    assert trained(config, tmp_path / "run") == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert message in error[-1]
    assert len([line for line in error if line.startswith("error: ")]) == 1
    assert time.monotonic() - began_s < START_TIMEOUT_S  # nobody waits for who refused


@pytest.mark.slow
def test_a_run_begins_with_a_policy_that_is_there(tmp_path, capsys):
    config, first = experiment(tmp_path / "one.toml"), tmp_path / "first"
    assert trained(config, first) == 0
    second = tmp_path / "second"
    assert trained(config, second, "--from", str(first)) == 0
    there = (first / "checkpoints" / "policy.npz").read_bytes()
    assert (second / "begun_from.npz").read_bytes() == there
    assert "started from the policy" in (second / "logs" / "learner.log").read_text()
    capsys.readouterr()
    assert trained(config, second, "--resume", "--from", str(first)) == 2
    assert "--from and --resume: expected one of them" in capsys.readouterr().err


def test_a_policy_to_begin_with_that_is_not_there_leaves_nothing(tmp_path, capsys):
    config, run = experiment(tmp_path / "one.toml"), tmp_path / "run"
    assert trained(config, run, "--from", str(tmp_path / "none.npz")) == 2
    assert "none.npz: no such file" in capsys.readouterr().err
    assert not run.exists()
