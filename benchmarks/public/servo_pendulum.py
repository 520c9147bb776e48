"""A Dynamixel XL330 that swings a pendulum: position commands at four firmware gains, 185 Hz.

Its authors identify friction models of six kinds. Known is what is in the simplest (m1) and in all
others; what only the others have (the Stribeck effect, friction that grows with the load) may be
there, and so may an offset of the encoder and a torque constant unlike the data sheet's.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from gfm.core import Trajectory
from gfm.importing.conversion import imported
from gfm.importing.mapping import load_mapping
from public.source import PublicSet, Reader, Repository

_MODELS = Path(__file__).parents[2] / "models"
_JOINT = "joint"
_FOLDER = "bam/data.bak/raw/2026-01-15_"
#: When a run was recorded, and the hash of its file.
_RUNS = {
    "10h28m10": "e58f3c2a08a5e0e37a2c5e930d0830a438bc102b8d21482767124f495b92f2ce",
    "10h28m17": "ef6507934ba465eb31529d7d98715ecc70bd5c87be049fd4618a94ce39290569",
    "10h28m24": "165b171df12b3e8b39504ce36d37e373ad105c0dddf4d3d073c747fd492e8bef",
    "10h28m32": "fdc255edae6995298af437f37582eb8cd0c4a5ddcec4f49fb7c4d6f3303aaa9c",
    "10h28m42": "1c6386bfa3be021c8ca8a96a7cbee93914f6271a050282b1c3b7d5ef373427db",
    "10h28m49": "e2223826274fca7799a2be0cb371e4269ead88cd9077fbb68498ef93e4e0de97",
    "10h28m57": "c10a350d9c7222d4d3499d140edd3ac4e63fe94f3b59a675116a34db7d66152c",
    "10h29m04": "7996c43314a9f60094a6119346b54ff9ff84cb6726c967f4a88a7175278f6515",
    "10h29m14": "016d15d21c464457aa30eaeab3977228b08cd5acf7542f24067440126c0bf480",
    "10h29m21": "fe68cff62e976c87a2fcab925a517fbff83be16c862693310fdc1eff743eddab",
    "10h29m29": "b9ce9fc0f396e6b03bd514e9254cb83b8a64e1a5df1728b9a10e3b4a5a9513ca",
    "10h29m37": "838d390b7190c4ce1608157cf629989648773b7336728a0931a61c6018c6700b",
    "10h29m47": "61ae8eeb881be5d8c09f6c7fba4cef39f66b1ff03e0148ef3bc0e314054513f5",
    "10h29m54": "b50055742ee553a8cb849b38d04d2b9bcf7143d0acefe6539f922984b93d958a",
    "10h30m02": "040e065f9885833fa909683f13665f90048ce5457d94dd2a3af056c21c36210d",
    "10h30m10": "01d32db99e7859f012a230aca59f1dda24219d6781472d356861b138526213e6",
}


def model(_read: Reader) -> str:
    """Returns the pendulum on a servo of the data sheet, with an ideal joint."""
    return (_MODELS / "xl330_pendulum.xml").read_text()


def _path(run: str) -> str:
    return f"{_FOLDER}{run}.json"


def _recordings(read: Reader) -> Sequence[Trajectory]:
    """Returns the runs, and apart what went on after the servo was switched off."""
    mapping = load_mapping(_MODELS / "mappings" / "xl330.toml")
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder, f"{run}.json") for run in _RUNS]
        for run, path in zip(_RUNS, paths, strict=True):
            path.write_bytes(read(_path(run)))
        return list(imported(paths, mapping))


SETS = (
    PublicSet(
        name="xl330_pendulum",
        robot="servo with a pendulum, position commands",
        repository=Repository(
            name="Rhoban/bam",
            commit="af2260462471ff45ac18af159b1327ea51d8db15",
            licence="Apache-2.0",
        ),
        files={_path(run): sha for run, sha in _RUNS.items()},
        recordings=_recordings,
        model=model,
        held_out=("kp200_sin_sin", "kp200_up_and_down", "kp200_sin_time_square"),
        known=frozenset(
            (effect, _JOINT) for effect in ("armature", "coulomb_friction", "viscous_friction")
        ),
        allowed=frozenset(
            (effect, _JOINT)
            for effect in (
                "actuator_gain",
                "encoder_offset",
                "load_dependent_friction",
                "stribeck_friction",
            )
        ),
        note="known: the authors' m1: armature, dry and viscous friction",
    ),
)
