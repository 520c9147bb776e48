"""Writes the nominal arm as MJCF: `python -m gfm.sim.export models`."""

from __future__ import annotations

import sys
from pathlib import Path

from gfm.core import CommandKind
from gfm.sim.sawyer import sawyer_spec

EXPORTED = (CommandKind.POSITION, CommandKind.VELOCITY)


def exported_models() -> dict[str, str]:
    """Returns the MJCF text by file name."""
    texts = {}
    for kind in EXPORTED:
        spec = sawyer_spec(command=kind)
        spec.compile()
        texts[f"sawyer_{kind}.xml"] = spec.to_xml()
    return texts


def main(folder: Path) -> None:
    """Writes every exported model into `folder`."""
    for name, text in exported_models().items():
        (folder / name).write_text(text)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "models"))
