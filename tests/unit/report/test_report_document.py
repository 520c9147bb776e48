"""report.json and report.html: the contract, strict JSON, nothing loaded, nothing unescaped."""

import gzip
import json
import math
import re
from base64 import b64encode, b85decode
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gfm.api.films.drawing import MOST_BYTES
from gfm.core import CommandKind, ShapeError
from gfm.diagnosis.output.result import (
    ErrorSummary,
    EvidencePlot,
    ModelPair,
    NamedEffect,
    ParameterEstimate,
    RecordingSummary,
    Series,
    Suspect,
    Verdict,
)
from gfm.report import (
    ModelKind,
    diagnosis_html,
    diagnosis_json,
    run_html,
    run_json,
    write_diagnosis,
    write_models,
    write_run,
)
from gfm.report.document import effect_json, jsonable
from gfm.report.film import Film
from gfm.report.page import packed
from gfm.report.words import interval

NAN = float("nan")
HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)>\"'&{{7*7}}"
EMPTY = {
    "effects": (),
    "suspects": (),
    "joints": {},
    "recordings": (),
    "plots": (),
    "notes": (),
    "provenance": {},
    "corrected_effects": (),
    "chain": None,
}


def strict(document):
    return json.loads(json.dumps(document, allow_nan=False))


def unpacked(text):
    """What the browser makes of packed text."""
    return gzip.decompress(b85decode(text.replace(",", "<").replace(".", "&"))).decode()


def page_data(page):
    """The figures in a page, as the browser gets them."""
    found = re.findall(r'<script type="text/plain">(.*?)</script>', page, re.DOTALL)
    return [json.loads(unpacked(text)) for text in found]


def without_plotly(page):
    return re.sub(r'<script type="text/plain" id="plotly">.*?</script>', "", page, flags=re.DOTALL)


def test_the_document_has_the_fields_of_the_contract(diagnosis_with):
    document = strict(diagnosis_json(diagnosis_with()))
    assert document["schema"] == "gfm.diagnosis/1"
    assert document["verdict"] == "explained"
    assert document["effects"][0] == {
        "effect": "coulomb_friction",
        "joints": ["right_j1"],
        "parameters": {"torque": {"value": 1.32, "unit": "N m", "ci95": [1.27, 1.37]}},
        "confidence": 0.97,
        "native": True,
        "evidence": {"nats": 5400.0, "z_without": 17.4, "apart": 0.06, "bends": 0.2},
        "equals": [],
    }
    assert document["suspects"][0]["reason"].startswith("explains 0.4 %")
    assert document["suspects"][0]["decided_by"].startswith("slow reversals")
    assert document["error"]["unit"] == "rad"
    assert document["error"]["ratio"] == pytest.approx(0.0013 / 0.0011)
    assert [line["joint"] for line in document["joints"]] == [f"right_j{i}" for i in range(7)]
    assert document["provenance"]["seed"] == 0


def test_errors_of_rollouts_that_begin_as_measured_stand_beside_the_fitted_ones(diagnosis_with):
    begun = ErrorSummary(before=0.25, after=0.0625, noise_floor=0.0125)
    diagnosis = diagnosis_with(as_measured=begun)
    document = strict(diagnosis_json(diagnosis))
    assert document["error_as_measured"] == {**vars(begun), "ratio": 5.0}
    assert strict(diagnosis_json(diagnosis_with()))["error_as_measured"] is None
    row = "begun as measured</td><td"
    assert row in without_plotly(diagnosis_html(diagnosis))
    assert row not in without_plotly(diagnosis_html(diagnosis_with()))


def test_intervals_that_are_withheld_or_without_end_are_null(diagnosis_with):
    cogging = strict(diagnosis_json(diagnosis_with()))["effects"][1]["parameters"]
    assert cogging["amplitude"]["ci95"] == [0.19, 0.23]
    assert cogging["per_revolution"]["ci95"] is None
    assert cogging["phase"]["ci95"] is None


def test_the_spread_stands_where_no_interval_would_hold():
    loose = ParameterEstimate(value=1.0, unit="N m", ci95=None, spread=0.25)
    assert interval(loose) == "roughly ± 0.250"
    drag = NamedEffect(
        effect="quadratic_drag",
        joints=("a",),
        parameters={"coefficient": loose},
        confidence=0.5,
        native=True,
    )
    told = effect_json(drag)["parameters"]["coefficient"]
    assert told == {"value": 1.0, "unit": "N m", "ci95": None, "spread": 0.25}


def test_numbers_that_are_not_finite_are_null(diagnosis_with):
    error = ErrorSummary(before=math.inf, after=NAN, noise_floor=0.0)
    document = strict(diagnosis_json(diagnosis_with(error=error)))
    assert document["error"] == {
        "before": None,
        "after": None,
        "noise_floor": 0.0,
        "unit": "rad",
        "ratio": None,
    }


def test_whatever_stands_in_the_provenance_becomes_strict_json():
    values = {
        "path": Path("a/b"),
        1: np.float32(0.5),
        "array": np.array([1.0, NAN]),
        "integer": np.int64(3),
        "truth": np.bool_(True),
        "verdict": Verdict.NO_GAP,
        "pair": (1, math.inf),
        "none": None,
    }
    assert strict(jsonable(values)) == {
        "path": "a/b",
        "1": 0.5,
        "array": [1.0, None],
        "integer": 3,
        "truth": True,
        "verdict": "no_gap",
        "pair": [1, None],
        "none": None,
    }


@pytest.mark.parametrize("verdict", list(Verdict))
@pytest.mark.parametrize("content", [{}, EMPTY])
def test_every_verdict_has_a_page_with_or_without_content(diagnosis_with, verdict, content):
    page = diagnosis_html(diagnosis_with(verdict=verdict, **content))
    assert f">{verdict.value.replace('_', ' ').capitalize()}</span>" in page
    assert "The model lacks dry friction of 1.32 N m" in page
    assert strict(diagnosis_json(diagnosis_with(verdict=verdict, **content)))["verdict"] == verdict


def test_the_page_shows_the_figures_of_the_diagnosis(diagnosis_with):
    page = diagnosis_html(diagnosis_with())
    for text in (
        "1.32 N m",
        "1.27 … 1.37",
        "withheld",
        "97 %",
        "no: hybrid stepping only",
        "below the 2.1 % that chance reaches",
        "slow reversals of right_j1",
        "3 gaps longer than 50 ms",
        "Record slow reversals of right_j6",
        "model.sha256",
    ):
        assert text in page


def test_every_plot_has_axis_titles_and_a_caption(run_with):
    page = run_html(run_with())
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", page)
    figures = page_data(page)
    assert len(figures) == len(captions) == 6
    assert all("Look for" in caption for caption in captions)
    for figure in figures:
        axes = [value for key, value in figure["layout"].items() if key.startswith("yaxis")]
        assert all(axis["title"]["text"] for axis in axes)
        below = [value for key, value in figure["layout"].items() if key.startswith("xaxis")]
        assert any(axis.get("title", {}).get("text") for axis in below)


def test_a_page_fits_a_phone(diagnosis_with):
    page = diagnosis_html(diagnosis_with())
    assert '<meta name="viewport" content="width=device-width, initial-scale=1">' in page
    narrow = page.partition("@media (max-width: 600px) {")[2].partition("\n}")[0]
    assert ".scroll > table { width: max-content;" in narrow
    assert (
        "table, figcaption, .card p, .small, .tile span, .bar-figures { font-size: 1rem; }"
        in narrow
    )
    bare = page.split("<table")[1:-1]
    assert len(bare) == page.count('<div class="scroll"><table')
    assert "if (touched) layout.dragmode = false;" in page


def test_pages_load_nothing_from_anywhere(run_with, diagnosis_with):
    for page in (run_html(run_with()), diagnosis_html(diagnosis_with())):
        own = without_plotly(page)
        assert "http" not in own.replace("http-equiv", "")
        assert not re.search(r"<(script|img|link|iframe)[^>]*(src|href)=", own)
        assert "default-src 'none'" in own
        assert "modeBarButtons:" in own


def test_hostile_names_stay_text(diagnosis_with, run_with, chain_with):
    effect = NamedEffect(
        effect=HOSTILE,
        joints=(HOSTILE,),
        parameters={HOSTILE: ParameterEstimate(value=1.0, unit=HOSTILE, ci95=None)},
        confidence=0.5,
        native=True,
    )
    line = Series(label=HOSTILE, x=np.arange(3.0), y=np.arange(3.0), style="line")
    plot = EvidencePlot(
        title=HOSTILE,
        effect=HOSTILE,
        joint=HOSTILE,
        x_label=HOSTILE,
        y_label=HOSTILE,
        series=(line,),
    )
    recording = RecordingSummary(
        name=HOSTILE,
        role=HOSTILE,
        command=HOSTILE,
        duration_s=1.0,
        rate_hz=1.0,
        before=1.0,
        after=1.0,
        warnings=(HOSTILE,),
    )
    diagnosis = diagnosis_with(
        sentence=HOSTILE,
        effects=(effect,),
        suspects=(Suspect(effect=HOSTILE, joints=(), reason=HOSTILE, decided_by=HOSTILE),),
        joints={HOSTILE: ErrorSummary(before=2.0, after=1.0, noise_floor=1.0)},
        recordings=(recording,),
        chain=chain_with((HOSTILE,), HOSTILE, (HOSTILE,), HOSTILE),
        plots=(plot,),
        notes=(HOSTILE,),
        provenance={HOSTILE: {HOSTILE: HOSTILE}},
    )
    for page in (
        diagnosis_html(diagnosis),
        run_html(run_with(diagnosis=diagnosis, run_id=HOSTILE, robot=HOSTILE)),
    ):
        own = without_plotly(page)
        assert "alert(1)</script>" not in own
        assert "<img" not in own
        assert "{{7*7}}" in own
        drawn = page_data(page)
        assert any("&lt;img" in json.dumps(figure) for figure in drawn)
        assert not any("<img" in json.dumps(figure) for figure in drawn)


def test_large_pages_stay_below_two_megabytes(diagnosis_with, run_with):
    diagnosis = diagnosis_with()
    diagnosis = replace(diagnosis, plots=diagnosis.plots * 12)
    report = run_with(diagnosis=diagnosis)
    film = Film(mp4=bytes(MOST_BYTES))
    pages = run_html(replace(report, rollouts=report.rollouts * 4)), diagnosis_html(diagnosis, film)
    assert max(len(page.encode()) for page in pages) < 2_000_000


def test_a_film_stands_in_the_page_with_what_it_shows(diagnosis_with):
    film = Film(mp4=b"film", recording=HOSTILE, length_s=2.0, slowed=4, enlarged=5, anew_s=0.5)
    page = diagnosis_html(diagnosis_with(), film)
    assert f'<video src="data:video/mp4;base64,{b64encode(b"film").decode()}"' in page
    told = without_plotly(page)
    for words in ("4 times slower", "every 0.5 s", "5 times as large"):
        assert words in told
    assert "alert(1)</script>" not in told
    assert "<video" not in diagnosis_html(diagnosis_with())


def test_a_film_that_is_not_there_says_why(diagnosis_with):
    page = diagnosis_html(diagnosis_with(), Film(missing="no film: <it> is dark"))
    assert "<p>no film: &lt;it&gt; is dark</p>" in page
    assert "<video" not in page


@settings(max_examples=50, deadline=None)
@given(st.text(max_size=400))
def test_what_is_packed_is_text_of_a_script_and_comes_out_again(text):
    told = packed(text)
    assert "<" not in told
    assert "&" not in told
    assert unpacked(str(told)) == text


def test_the_run_document_contains_the_diagnosis(run_with):
    report = run_with()
    document = strict(run_json(report))
    assert document["schema"] == "gfm.run/1"
    assert document["diagnosis"] == strict(diagnosis_json(report.diagnosis))
    nominal = document["comparison"]["models"][0]
    assert nominal["model"] == "nominal"
    assert nominal["ratio"] == pytest.approx(0.0322 / 0.0011)
    assert set(nominal["joints"]) == {f"right_j{index}" for index in range(7)}
    assert document["system"]["learner_steps"] == 4200
    assert [one["role"] for one in document["system"]["processes"]][:2] == ["replay", "learner"]
    assert document["revealed"]["hidden"][0]["parameters"]["torque"] == {
        "value": 1.3,
        "unit": "N m",
    }


def test_a_run_without_a_fit_without_a_sealed_file_and_without_rollouts_has_a_page(run_with):
    report = run_with(training=(), hidden=None, rollouts=())
    page = run_html(report)
    assert "The fit of a GFM was skipped" in page
    assert "Revealed after the verdict" not in page
    assert strict(run_json(report))["revealed"] is None


def test_the_truth_comes_after_the_verdict_and_says_that_the_robot_is_simulated(run_with):
    page = run_html(run_with())
    revealed = page.index("Revealed after the verdict; the robot here is simulated")
    assert page.index("<h1>") < page.index("What else was considered") < revealed


def test_a_rollout_of_the_wrong_shape_is_refused(run_with):
    rollout = run_with().rollouts[0]
    with pytest.raises(ShapeError, match="prediction of hybrid has shape"):
        replace(rollout, predicted={ModelKind.HYBRID: np.zeros((3, 7))})


def test_a_comparison_with_a_missing_joint_is_refused(run_with):
    comparison = run_with().comparison
    with pytest.raises(ShapeError, match="joint_noise_floors has shape"):
        replace(comparison, joint_noise_floors=(0.1,))


def test_the_files_of_a_diagnosis_are_whole_and_alone(diagnosis_with, tmp_path):
    folder = tmp_path / "new" / "out"
    paths = write_diagnosis(folder, diagnosis_with())
    assert sorted(path.name for path in folder.iterdir()) == [
        "corrected.effects.json",
        "corrected.xml",
        "report.html",
        "report.json",
    ]
    assert all(path.exists() for path in paths)
    assert (folder / "corrected.xml").read_text() == "<mujoco/>"
    effects = json.loads((folder / "corrected.effects.json").read_text())
    assert effects["effects"][0]["effect"] == "cogging_torque"


def twins(diagnosis):
    """Returns corrected models of two kinds; beside the first stand effects."""
    alone, pair = (ModelPair(xml="<mujoco/>", effects=e) for e in ((), diagnosis.effects[:1]))
    return {CommandKind.POSITION: pair, CommandKind.VELOCITY: alone}


def test_a_diagnosis_writes_a_model_for_every_kind_of_command(diagnosis_with, tmp_path):
    plain = diagnosis_with(corrected_effects=())
    (tmp_path / "corrected_velocity.effects.json").write_text("of an older diagnosis")
    write_diagnosis(tmp_path, replace(plain, twins=twins(plain)))
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "corrected.xml",
        "corrected_position.effects.json",
        "corrected_position.xml",
        "corrected_velocity.xml",
        "report.html",
        "report.json",
    ]


def test_corrected_models_are_written_for_others_to_load(diagnosis_with, tmp_path):
    written = write_models(tmp_path / "models", twins(diagnosis_with()))
    assert {kind: path.name for kind, path in written.items()} == {
        CommandKind.POSITION: "corrected_position.xml",
        CommandKind.VELOCITY: "corrected_velocity.xml",
    }
    assert sorted(path.name for path in (tmp_path / "models").iterdir()) == [
        "corrected_position.effects.json",
        "corrected_position.xml",
        "corrected_velocity.xml",
    ]


def test_no_effects_file_is_written_where_all_effects_are_native(
    run_with, diagnosis_with, tmp_path
):
    paths = write_run(tmp_path, run_with(diagnosis=diagnosis_with(corrected_effects=())))
    assert {path.name for path in paths} == {"report.json", "report.html", "corrected.xml"}
