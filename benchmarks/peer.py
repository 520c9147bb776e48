"""What one peer makes of one case.

python benchmarks/peer.py --peer CMA-ES --case DIR --out FILE
"""

from __future__ import annotations

import argparse
import json
from importlib import import_module
from pathlib import Path

from peers.case import answer, load

#: Module and function of each; imported when asked for, since each needs a package of its own.
PEERS = {
    "mujoco.sysid": ("peers.toolbox", "toolbox"),
    "PySINDy STLSQ": ("peers.regression", "stlsq"),
    "PySINDy FROLS": ("peers.regression", "frols"),
    "CMA-ES": ("peers.evolution", "cma"),
    "refit ladder": ("peers.ladder", "ladder"),
}


def main() -> None:
    """Asks the peer and writes its answer in the form of a report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peer", choices=sorted(PEERS), required=True)
    parser.add_argument("--case", type=Path, required=True, metavar="DIR")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE")
    arguments = parser.parse_args()
    module, function = PEERS[arguments.peer]
    case = load(arguments.case)
    named, after = getattr(import_module(module), function)(case)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(answer(case, named, after), indent=1))


if __name__ == "__main__":
    main()
