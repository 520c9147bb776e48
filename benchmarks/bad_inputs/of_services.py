"""Bad input of services and of the commands that start and ask them."""

from __future__ import annotations

from bad_inputs.making import Case, cases, model, text

#: Nobody listens there: TCP's "discard", which needs root.
_NOBODY = "tcp/127.0.0.1:9"


def _nobody(command: str, *words: str, status: int = 2) -> Case:
    told = [*words, "--connect", _NOBODY]
    return Case(command=command, wrong="nobody there", words=lambda: told, status=status)


UP = cases(
    "gfm up",
    ("an unknown environment", lambda: ["--env", "chess", "--dir", "d"]),
    ("no actors", lambda: ["--actors", "0", "--dir", "d"]),
    ("a model without its kind", lambda: ["--model", model(), "--dir", "d"]),
    ("a model that is not there", lambda: ["--model", "position=absent.xml", "--dir", "d"]),
    ("a folder of settings that is not there", lambda: ["--config-dir", "absent", "--dir", "d"]),
)
ROBOT = (
    *cases(
        "gfm robot",
        ("no word what to do", list),
        ("an unknown word", lambda: ["dance"]),
        ("a speed without its scale", lambda: ["speed"]),
        ("a speed above 1", lambda: ["speed", "2"]),
    ),
    _nobody("gfm robot", "stop", status=1),
    _nobody("gfm status"),
)
ACCESS = (
    cases(
        "gfm certs",
        ("a host that is none", lambda: ["--out", "d", "--host", "a/b"]),
        ("certificates that end at once", lambda: ["--out", "d", "--days", "0"]),
        ("a folder below a file", lambda: ["--out", text("taken", "") + "/d"]),
    )
    + cases(
        "gfm status",
        ("certificates that are not there", lambda: ["--certs", "absent"]),
    )
    + cases(
        "gfm router",
        ("open to the network by TCP", lambda: ["--listen", "tcp/0.0.0.0:7447"]),
    )
    + cases(
        "gfm metrics",
        ("open to the network", lambda: ["--http", "0.0.0.0:9464"]),
        ("an address that is none", lambda: ["--http", "here"]),
    )
    + cases(
        "gfm watch",
        ("no viewer", list),
        ("open to the network", lambda: ["--foxglove", "0.0.0.0:8765"]),
        ("an address that is none", lambda: ["--rerun", "here"]),
    )
)
SERVICES = (
    *cases(
        "gfm-actor",
        ("settings that are not there", lambda: ["--config", "absent.toml"]),
        ("an unknown setting", lambda: ["--config", text("a.toml", "speed = 1\n")]),
        ("no environments", lambda: ["--num-envs", "0"]),
        ("an endpoint that is none", lambda: ["--connect", "here"]),
    ),
    *cases(
        "gfm-learner",
        ("a batch of nothing", lambda: ["--batch-size", "0"]),
        ("a log level that does not exist", lambda: ["--log-level", "loud"]),
    ),
    *cases("gfm-replay", ("no capacity", lambda: ["--capacity-mib", "0"])),
    *cases(
        "gfm-robot-bridge",
        ("a robot that does not exist", lambda: ["--robot", "pr2"]),
        ("a share of the speed above 1", lambda: ["--velocity-share", "2"]),
    ),
)
CASES: tuple[Case, ...] = (*UP, *ROBOT, *ACCESS, *SERVICES)
