"""The page on how a diagnosis works tells the constants that decide as they are."""

import re
from pathlib import Path

from gfm.diagnosis.inference import constants

PAGE = Path(__file__).parents[2] / "docs" / "how_a_diagnosis_works.md"


def test_the_page_has_every_constant_that_decides_with_its_value():
    rows = re.findall(r"^\| `([A-Z_]+)` \| ([-\d., ]+) \|", PAGE.read_text(), flags=re.MULTILINE)
    told = {name: tuple(float(x) for x in values.split(",")) for name, values in rows}
    own = {name: value for name, value in vars(constants).items() if name.isupper()}
    assert told == {n: v if isinstance(v, tuple) else (v,) for n, v in own.items()}
