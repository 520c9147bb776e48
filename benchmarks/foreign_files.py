"""Makes files as other people have them in the current folder: for the notebooks in docs/.

python benchmarks/foreign_files.py lerobot --data ../shared/data
"""

from __future__ import annotations

import argparse
from pathlib import Path

from foreign import Sources
from transcripts import WAYS


def main() -> None:
    """Makes the files of one way."""
    ways = {way.name: way for way in WAYS}
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("way", choices=ways)
    parser.add_argument("--data", type=Path, required=True, metavar="DIR")
    arguments = parser.parse_args()
    way = ways[arguments.way]
    way.make(Path(), Sources(data=arguments.data, most=way.recordings))


if __name__ == "__main__":
    main()
