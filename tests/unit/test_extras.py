"""What a missing package is told as."""

from __future__ import annotations

import pytest

from gfm.core import ConfigError
from gfm.core.extras import needs


def test_a_missing_package_names_the_extra_that_installs_it() -> None:
    expected = (
        "^tracking needs the package no_such_package, not installed; expected it: "
        r"pip install 'gfm-sim2real\[tracking\]'$"
    )
    with (
        pytest.raises(ConfigError, match=expected),
        needs("tracking needs", "no_such_package", "tracking"),
    ):
        import no_such_package.part  # noqa: F401


def test_another_missing_package_is_not_hidden() -> None:
    with pytest.raises(ModuleNotFoundError), needs("tracking needs", "cv2", "tracking"):
        import no_such_package  # noqa: F401


def test_what_is_there_is_imported() -> None:
    with needs("arrays need", "numpy", "none"):
        import numpy
    assert numpy.zeros(1)[0] == 0.0
