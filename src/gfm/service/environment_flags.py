"""The flags that say which environment, the same for every command that takes one."""

from __future__ import annotations

import argparse


def add_environment_flags(parser: argparse.ArgumentParser) -> None:
    """Adds the flags of `EnvironmentSettings` that are not left to a settings file."""
    group = parser.add_argument_group("environment")
    group.add_argument("--env", metavar="NAME", help="gfm_fit, point_mass ... (default: gfm_fit)")
    group.add_argument(
        "--model",
        dest="environment.models",
        action=_KindedPath,
        metavar="KIND=FILE",
        help="MJCF for commands of KIND (position, velocity, effort), once per kind; of FILE.xml "
        "FILE.effects.json beside it is read as part",
    )
    group.add_argument(
        "--recording",
        dest="environment.recordings",
        action="append",
        metavar="FILE",
        help="MCAP recording; may be given several times",
    )
    group.add_argument(
        "--horizon",
        dest="environment.horizon",
        type=int,
        metavar="N",
        help="control periods per episode",
    )
    group.add_argument(
        "--control-period-s",
        dest="environment.control_period_s",
        type=float,
        metavar="SECONDS",
        help="between two decisions",
    )
    group.add_argument(
        "--joint-nm",
        dest="environment.joint_nm",
        type=float,
        metavar="TORQUE",
        help="largest generalized force on a joint, N m",
    )
    group.add_argument(
        "--object-n",
        dest="environment.object_n",
        type=float,
        metavar="FORCE",
        help="largest generalized force on the object, N",
    )
    group.add_argument(
        "--object-nm",
        dest="environment.object_nm",
        type=float,
        metavar="TORQUE",
        help="largest generalized torque on the object, N m",
    )
    group.add_argument(
        "--forced-joint",
        dest="environment.forced_joints",
        action="append",
        metavar="NAME",
        help="joint that generalized forces act on; may be given several times (default: all)",
    )
    group.add_argument(
        "--scale",
        dest="environment.scale",
        action="append",
        type=float,
        metavar="X",
        help="by which one channel of the difference is divided, rad, rad/s or m; once for each "
        "channel (default: measured from the recordings)",
    )


class _KindedPath(argparse.Action):
    """Collects KIND=FILE into a mapping."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: object,
        _option: str | None = None,
    ) -> None:
        kind, equals, path = str(values).partition("=")
        if not (kind and equals and path):
            parser.error(f"--model {values}: expected KIND=FILE")
        given = dict(getattr(namespace, self.dest, {}))
        setattr(namespace, self.dest, given | {kind: path})
