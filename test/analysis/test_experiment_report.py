"""The report through what it writes: page, figures, tables and signals of small trials."""

from __future__ import annotations

import csv
import dataclasses
import datetime
import math
import re
from collections.abc import Mapping
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from PIL import Image

from haptic_accel.analysis.experiment_report import write_report
from haptic_accel.core.evaluation.metrics import TABLE_II, Evaluation
from haptic_accel.core.trial import Trial

SURFACES = ("plywood", "text", "vinyl")
CONTROLLERS = ("none", "constant", "dynamic")
FIGURES = ("fig9_time.png", "fig10_regression.png", "fig11_spectra.png")
DASH = "–"

# NRMSE in percent by (surface, controller); the averages are 100, 70 and 60.3.
MEASURED = {
    ("plywood", "none"): 99.5,
    ("text", "none"): 100.0,
    ("vinyl", "none"): 100.5,
    ("plywood", "constant"): 61.04,
    ("text", "constant"): 70.0,
    ("vinyl", "constant"): 78.96,
    ("plywood", "dynamic"): 50.2,
    ("text", "dynamic"): 60.3,
    ("vinyl", "dynamic"): 70.4,
}


@dataclasses.dataclass(frozen=True)
class Condition:
    trial: Trial
    evaluation: Evaluation
    age_us: Mapping[str, float] | None = None
    lost: Mapping[str, int] | None = None
    late: Mapping[str, int] | None = None
    bag: Path | None = None


def trial(
    surface: str = "plywood",
    controller: str = "dynamic",
    *,
    gain: float = 0.8,
    rate: float = 1000.0,
    seconds: float = 0.5,
) -> Trial:
    """Noise as the tool's acceleration, and a handle that follows one sample later."""
    samples = int(rate * seconds)
    tool = np.random.default_rng(5).normal(0.0, 3.0, samples)
    return Trial(
        surface=surface,
        controller=controller,
        rate=rate,
        time=np.arange(samples) / rate,
        tool_acceleration=tool,
        desired_acceleration=tool - tool.mean(),
        handle_acceleration=gain * np.concatenate([[0.0], tool[:-1]]),
        actuator_force=0.128 * tool,
    )


def condition(
    surface: str = "plywood",
    controller: str = "dynamic",
    evaluation: Evaluation | None = None,
    **live: object,
) -> Condition:
    evaluation = evaluation or Evaluation(60.0, 0.75, 0.8, 0.6)
    return Condition(trial(surface, controller), evaluation, **live)  # type: ignore[arg-type]


def nine() -> list[Condition]:
    return [
        condition(surface, controller, Evaluation(MEASURED[surface, controller], 0.6, 1.1, 0.66))
        for surface in SURFACES
        for controller in CONTROLLERS
    ]


def report(conditions: list[Condition], folder: Path, **changes: object) -> Path:
    arguments: dict[str, object] = {
        "title": "An experiment",
        "settings": {"seed": "7", "rig": "simulated"},
        "paper_table": TABLE_II,
    }
    return write_report(conditions, folder, **(arguments | changes))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def nine_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a report of the nine conditions, once because it is only read."""
    folder = tmp_path_factory.mktemp("results") / "now"
    assert report(nine(), folder) == folder / "index.html"
    return folder


class Page(HTMLParser):
    """What a reader meets in a page: tables as lists of rows, links, tags, and the text."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.links: list[str] = []
        self.alternatives: list[str] = []
        self.tables: list[list[list[str]]] = []
        self.text = ""
        self._cell: list[str] | None = None
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = dict(attrs)
        self.tags.append(tag)
        self.links += [attributes[name] or "" for name in ("href", "src") if name in attributes]
        if tag == "img":
            self.alternatives.append(attributes["alt"] or "")
        elif tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in {"td", "th"}:
            self._cell = self.tables[-1][-1]
            self._cell.append("")

    def handle_endtag(self, tag: str) -> None:
        if tag in {"td", "th"}:
            self._cell = None

    def handle_data(self, data: str) -> None:
        if self.lasttag != "style":
            self.text += data
        if self._cell is not None:
            self._cell[-1] += data


def row_of(table: list[list[str]], name: str) -> list[str]:
    """Return the cells after a row's name."""
    return next(row[1:] for row in table if row[0] == name)


def size_of(path: Path) -> tuple[int, int]:
    """Decode a picture that is not blank."""
    with Image.open(path) as image:
        assert len(image.convert("L").getcolors() or []) > 20
        return image.width, image.height


def rows_of_csv(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_writes_page_figures_and_tables_into_a_new_folder(nine_folder: Path) -> None:
    signals = {f"signals_{s}_{c}.csv" for s in SURFACES for c in CONTROLLERS}
    assert {path.name for path in nine_folder.iterdir()} == {
        "index.html",
        "table.csv",
        *FIGURES,
        *signals,
    }


def test_figures_grow_with_the_number_of_panels(nine_folder: Path, tmp_path: Path) -> None:
    report([condition()], tmp_path)
    for name in FIGURES:
        large, small = size_of(nine_folder / name), size_of(tmp_path / name)
        assert 600 <= small[0] < large[0] <= 3000
        assert 300 <= small[1] < large[1] <= 3000


def test_same_conditions_give_the_same_files(tmp_path: Path) -> None:
    for folder in ("one", "two"):
        report([condition()], tmp_path / folder)
    for name in (*FIGURES, "table.csv", "signals_plywood_dynamic.csv"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_table_csv_has_a_line_for_each_condition(tmp_path: Path) -> None:
    evaluation = Evaluation(61.23456, -0.5, 1.25, 0.625)
    live = condition(
        "text",
        "constant",
        evaluation,
        age_us={"p50": 131.5, "p99": 223.0, "max": 1204.0},
        lost={"slave/tool/acceleration": 2, "master/handle/acceleration": 1},
        late={},
    )
    report([live, condition("recording")], tmp_path)
    first, second = rows_of_csv(tmp_path / "table.csv")
    assert (first.pop("surface"), first.pop("controller")) == ("text", "constant")
    assert {name: float(value) for name, value in first.items()} == {
        "nrmse_percent": 61.23456,
        "paper_percent": 80.6,
        "slope_desired_on_actual": -0.5,
        "slope_actual_on_desired": 1.25,
        "r2": 0.625,
        "seconds": 0.5,
        "age_p50_us": 131.5,
        "age_p99_us": 223.0,
        "age_max_us": 1204.0,
        "lost": 3,
        "late": 0,
    }
    empty = ("paper_percent", "age_p50_us", "age_p99_us", "age_max_us", "lost", "late")
    assert {second[name] for name in empty} == {""}


def test_signals_csv_holds_the_trial_in_named_units(tmp_path: Path) -> None:
    one = condition()
    report([one], tmp_path)
    path = tmp_path / "signals_plywood_dynamic.csv"
    columns = {
        "time_s": one.trial.time,
        "tool_acceleration_m_s2": one.trial.tool_acceleration,
        "desired_acceleration_m_s2": one.trial.desired_acceleration,
        "handle_acceleration_m_s2": one.trial.handle_acceleration,
        "actual_acceleration_m_s2": one.trial.actual_acceleration,
        "actuator_force_N": one.trial.actuator_force,
    }
    with path.open(encoding="utf-8") as file:
        assert file.readline().strip().split(",") == list(columns)
    read = np.loadtxt(path, delimiter=",", skiprows=1)
    np.testing.assert_allclose(read, np.column_stack(list(columns.values())), rtol=1e-8)


def test_page_shows_table_two_beside_the_papers(nine_folder: Path) -> None:
    table = Page(nine_folder / "index.html").tables[0]
    assert table[0] == ["controller", "plywood", "text", "vinyl", "average"]
    assert table[1] == ["here", "paper"] * 4
    cells = {name: row_of(table, name) for name in CONTROLLERS}
    assert cells["none"][:4] == ["99.5 %", "99.6 %", "100.0 %", "99.5 %"]
    assert cells["constant"][:4] == ["61.0 %", "69.8 %", "70.0 %", "80.6 %"]
    assert cells["dynamic"][4:6] == ["70.4 %", "82.8 %"]


def test_averages_over_surfaces_stand_beside_the_ones_that_the_paper_states(
    nine_folder: Path,
) -> None:
    table = Page(nine_folder / "index.html").tables[0]
    assert [row_of(table, name)[6:] for name in CONTROLLERS] == [
        ["100.0 %", "99.5 %"],
        ["70.0 %", "79.1 %"],
        ["60.3 %", "72.0 %"],
    ]


def test_an_average_over_some_surfaces_is_not_compared_with_the_papers(tmp_path: Path) -> None:
    two = [one for one in nine() if one.trial.surface != "vinyl"]
    table = Page(report(two, tmp_path)).tables[0]
    assert row_of(table, "dynamic") == ["50.2 %", "65.1 %", "60.3 %", "73.2 %", "55.2 %", DASH]


def test_page_shows_both_slopes_and_their_average(tmp_path: Path) -> None:
    conditions = [
        condition("plywood", "constant", Evaluation(80.0, 0.60, 1.08, 0.65)),
        condition("text", "constant", Evaluation(80.0, 0.70, -1.00, 0.55)),
    ]
    table = Page(report(conditions, tmp_path)).tables[1]
    assert [cell for cell in table[0] if "slope" in cell] == [
        "slope, desired on actual",
        "slope, actual on desired",
    ]
    assert table[1] == ["constant", "plywood", "0.60", "1.08", "0.65"]
    assert table[2] == ["text", "0.70", "−1.00", "0.55"]
    assert table[3] == ["average", "0.65", "0.04", "0.60"]


def test_page_shows_age_lost_and_late(tmp_path: Path) -> None:
    live = condition(
        age_us={"p50": 131.2, "p99": 223.7, "max": 1204.0},
        lost={"slave/tool/acceleration": 2, "master/handle/acceleration": 0},
        late={"master_device": 3},
    )
    page = Page(report([live], tmp_path))
    assert page.tables[2][1][2:9] == ["0.5", "1000", "131", "224", "1204", "2", "3"]
    assert "lost slave/tool/acceleration 2, late master_device 3" in page.text
    assert "master/handle/acceleration" not in page.text


def test_lockstep_has_no_word_of_ages(tmp_path: Path) -> None:
    page = Page(report([condition()], tmp_path))
    assert "age" not in re.findall(r"\w+", page.text)
    assert "lost" not in page.text


def test_a_surface_that_the_paper_has_not_gets_a_dash(tmp_path: Path) -> None:
    table = Page(report([condition("recording")], tmp_path)).tables[0]
    assert table == [
        ["controller", "recording"],
        ["here", "paper"],
        ["dynamic", "60.0 %", DASH],
    ]


def test_a_condition_that_was_not_run_gets_a_dash_and_so_does_its_average(tmp_path: Path) -> None:
    conditions = [condition("plywood", "none"), condition("text", "dynamic")]
    table = Page(report(conditions, tmp_path)).tables[0]
    assert row_of(table, "none") == ["60.0 %", "99.6 %", DASH, "99.5 %", DASH, DASH]
    assert row_of(table, "dynamic") == [DASH, "65.1 %", "60.0 %", "73.2 %", DASH, DASH]


def test_title_time_settings_and_notes_are_on_the_page(tmp_path: Path) -> None:
    page = Page(
        report(
            [condition()],
            tmp_path,
            title="Nine conditions",
            settings={"arguments": "rate:=1000", "seed": "7"},
            notes=["The first note.", "The second note."],
            when=datetime.datetime(2030, 4, 1, 9, 30, tzinfo=datetime.timezone.utc),
        )
    )
    assert page.text.count("Nine conditions") == 2
    assert "2030-0" in page.text  # in the reader's time zone
    assert page.tables[-1] == [["arguments", "rate:=1000"], ["seed", "7"]]
    assert page.text.index("The first note.") < page.text.index("The second note.")


def test_every_link_leads_to_a_file_of_the_report(tmp_path: Path) -> None:
    bag = tmp_path / "bags" / "plywood #1 100%"
    bag.mkdir(parents=True)
    page = Page(report([condition(bag=bag), condition("text")], tmp_path))
    targets = {tmp_path / unquote(link) for link in page.links}
    assert all(target.exists() for target in targets)
    assert {bag, tmp_path / "table.csv", tmp_path / "signals_text_dynamic.csv"} <= targets
    assert {tmp_path / name for name in FIGURES} <= targets


def test_figures_have_alternative_texts_that_name_the_conditions(nine_folder: Path) -> None:
    page = Page(nine_folder / "index.html")
    assert len(page.alternatives) == 3
    for text in page.alternatives:
        assert all(name in text for name in (*SURFACES, *CONTROLLERS))


def test_page_needs_no_script_and_nothing_from_elsewhere(nine_folder: Path) -> None:
    path = nine_folder / "index.html"
    assert "script" not in Page(path).tags
    source = path.read_text(encoding="utf-8")
    assert "://" not in source
    assert "@import" not in source
    assert "url(" not in source


@pytest.mark.parametrize(
    "hostile",
    [
        "<script>alert(1)</script>",
        '"><img src=x onerror=alert(1)>',
        "{{ 7 * 7 }} & $x_{2$ \\frac",
        "../../elsewhere/ name\nwith lines",
    ],
)
def test_hostile_names_stay_text(hostile: str, tmp_path: Path) -> None:
    folder = tmp_path / "report"
    conditions = [condition(hostile, "none"), condition("text", hostile)]
    conditions[0] = dataclasses.replace(conditions[0], lost={hostile: 1}, bag=tmp_path / "x/y")
    path = report(conditions, folder, title=hostile, settings={hostile: hostile}, notes=[hostile])
    page = Page(path)
    assert "script" not in page.tags
    assert page.tags.count("img") == 3
    assert page.text.count(hostile) >= 8
    assert list(tmp_path.iterdir()) == [folder]
    assert len(list(folder.glob("signals_*.csv"))) == 2
    assert rows_of_csv(folder / "table.csv")[0]["surface"] == hostile


def test_names_that_differ_in_signs_alone_keep_their_own_signals(tmp_path: Path) -> None:
    report([condition("a/b"), condition("a b"), condition("a_b")], tmp_path)
    assert len(list(tmp_path.glob("signals_*.csv"))) == 3


def test_numbers_that_are_none_never_reach_the_reader(tmp_path: Path) -> None:
    nothing = condition(
        evaluation=Evaluation(math.nan, math.inf, -math.inf, math.nan),
        age_us={"p50": math.nan, "p99": math.nan, "max": math.nan},
        lost={},
    )
    page = Page(report([nothing, condition("text")], tmp_path))
    assert not {"nan", "inf"} & {word.lower() for word in re.findall(r"[A-Za-z]+", page.text)}
    assert row_of(page.tables[0], "dynamic")[0] == DASH
    first = rows_of_csv(tmp_path / "table.csv")[0]
    assert first["nrmse_percent"] == first["r2"] == first["age_p50_us"] == ""


def test_no_minus_before_a_zero(tmp_path: Path) -> None:
    table = Page(report([condition(evaluation=Evaluation(99.96, -1e-9, -1e-9, 0.0))], tmp_path))
    assert table.tables[1][1][2:] == ["0.00", "0.00", "0.00"]


@pytest.mark.parametrize("rate", [500.0, 1000.0, 4000.0])
def test_a_handle_at_rest_can_be_drawn(rate: float, tmp_path: Path) -> None:
    still = trial(controller="none", gain=0.0, rate=rate)
    assert not still.actual_acceleration.any()
    report([Condition(still, Evaluation(100.0, 0.0, 0.0, 0.0))], tmp_path)
    assert (tmp_path / "fig11_spectra.png").stat().st_size > 0


def test_no_condition_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="at least one is needed"):
        report([], tmp_path / "report")
    assert not (tmp_path / "report").exists()


def test_the_same_condition_twice_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="plywood with dynamic"):
        report([condition(), condition()], tmp_path)
