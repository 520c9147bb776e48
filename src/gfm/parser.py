"""Parsers of command lines that say in one line what is wrong."""

from __future__ import annotations

import argparse
import re
from typing import Any, NoReturn, final

from typing_extensions import override


@final
class OneLineParser(argparse.ArgumentParser):
    """A parser whose errors are one line and exit status 2, as those of all bad input."""

    def __init__(self, *arguments: Any, **named: Any) -> None:  # noqa: ANN401 (as argparse has)
        super().__init__(*arguments, **named)
        # Python's own takes -4.9e-07 for an option; no option here begins with a digit.
        self._negative_number_matcher = re.compile(r"^-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")

    @override
    def error(self, message: str) -> NoReturn:
        said = " ".join(message.split())
        self.exit(2, f"error: {said} (`{self.prog} --help` tells what is expected)\n")
