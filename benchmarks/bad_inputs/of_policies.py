"""Bad input of the commands that plan, train, test and drive."""

from __future__ import annotations

from pathlib import Path

from bad_inputs.making import MODEL, Case, cases, folder, model, text
from gfm.policies import shipped_policy

_TRAIN = 'env = "position_matching"\nlearner_steps = 10\n'


def _policy(task: str) -> str:
    """Copies the policy that comes with gfm for a task; returns the file's name."""
    return text("policy.npz", shipped_policy(task).read_bytes())


def _in_use() -> str:
    folder("out")
    Path("out/thesis.tex").touch()
    return "out"


def _train(config: str, *words: str) -> list[str]:
    return ["--config", text("train.toml", config), *words]


EXCITE = cases(
    "gfm excite",
    ("no model", lambda: ["--out", "plan"]),
    ("nowhere to write to", lambda: ["--model", model()]),
    (
        "an effect that does not exist",
        lambda: ["--model", model(), "--out", "plan", "--for", "luck"],
    ),
    ("a joint that does not exist", lambda: ["--model", model(), "--out", "plan", "--joint", "c"]),
    ("a range that is none", lambda: ["--model", model(), "--out", "plan", "--range", "a=2:1"]),
    ("a pose that does not exist", lambda: ["--model", model(), "--out", "plan", "--pose", "home"]),
    (
        "a report that is none",
        lambda: ["--model", model(), "--out", "p", "--report", text("r.json", "{}")],
    ),
    ("no seconds", lambda: ["--model", model(), "--out", "plan", "--seconds", "0"]),
)
TRAIN = cases(
    "gfm train",
    ("a file of settings that is not there", lambda: ["--config", "absent.toml"]),
    ("settings that are no TOML", lambda: _train("hello")),
    ("an unknown setting", lambda: _train(_TRAIN + "speed = 1\n")),
    ("an unknown environment", lambda: _train(_TRAIN.replace("position_matching", "chess"))),
    ("a setting out of range", lambda: _train(_TRAIN + "actors = 0\n")),
    (
        "a policy for another task",
        lambda: _train(_TRAIN, "--out", "out", "--from", _policy("pose_matching")),
    ),
    ("nothing to resume", lambda: _train(_TRAIN, "--resume", "--out", "runs")),
)
EVALUATE = cases(
    "gfm evaluate",
    ("an unknown task", lambda: ["--task", "chess"]),
    ("a policy that is not there", lambda: ["--task", "position", "--policy", "absent.npz"]),
    ("a policy that is none", lambda: ["--task", "position", "--policy", text("p.npz", "hello")]),
    (
        "a policy for another task",
        lambda: ["--task", "position", "--policy", _policy("pose_matching")],
    ),
    ("a model of another robot", lambda: ["--task", "position", "--model", model()]),
    ("forces that are not there", lambda: ["--task", "position", "--forces", "absent.npz"]),
    ("no attempts", lambda: ["--task", "position", "--trials", "0"]),
)
DRIVE = cases(
    "gfm drive",
    (
        "a policy for another task",
        lambda: ["--task", "pose", "--policy", _policy("position_matching"), "--out", "out"],
    ),
    ("a folder that is in use", lambda: ["--task", "pose", "--out", _in_use()]),
    (
        "an effect that no robot hides",
        lambda: ["--task", "pose", "--hidden-effect", "luck", "--out", "out"],
    ),
    ("an endpoint that is none", lambda: ["--task", "pose", "--connect", "here", "--out", "out"]),
)
TRANSFER = cases(
    "gfm transfer",
    (
        "a policy for another task",
        lambda: ["--task", "pose", "--policy", _policy("position_matching"), "--out", "out"],
    ),
    ("an unknown treatment", lambda: ["--task", "pose", "--treatments", "luck", "--out", "out"]),
    ("less than no time", lambda: ["--task", "pose", "--minutes", "-1", "--out", "out"]),
    (
        "motions that are too short",
        lambda: ["--task", "pose", "--air-seconds", "3", "--out", "out"],
    ),
    ("a folder that is in use", lambda: ["--task", "pose", "--out", _in_use()]),
)
ADAPT = cases(
    "gfm adapt",
    (
        "a model that is not there",
        lambda: ["--task", "pose", "--model", "absent.xml", "--out", "p.npz"],
    ),
    ("a model of another robot", lambda: ["--task", "pose", "--model", model(), "--out", "p.npz"]),
)
RUN = cases(
    "gfm run",
    ("an effect that no robot hides", lambda: ["--hidden-effect", "luck", "--out", "out"]),
    ("a folder that is in use", lambda: ["--out", _in_use()]),
    ("too many actors", lambda: ["--actors", "1000", "--out", "out"]),
    ("a model of another robot", lambda: ["--model", model(MODEL), "--out", "out"]),
    ("actors that are no number", lambda: ["--actors", "two"]),
)
CASES: tuple[Case, ...] = (*EXCITE, *TRAIN, *EVALUATE, *DRIVE, *TRANSFER, *ADAPT, *RUN)
