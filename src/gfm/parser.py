"""Parsers of command lines that say in one line what is wrong."""

from __future__ import annotations

import argparse
from typing import NoReturn, final

from typing_extensions import override


@final
class OneLineParser(argparse.ArgumentParser):
    """A parser whose errors are one line and exit status 2, as those of all bad input."""

    @override
    def error(self, message: str) -> NoReturn:
        said = " ".join(message.split())
        self.exit(2, f"error: {said} (`{self.prog} --help` tells what is expected)\n")
