"""A study with people: its design, its files, its task and its questions; no browser."""

from __future__ import annotations

import dataclasses
import itertools
import json
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rcmqp.cli import main
from rcmqp.cli.trial import _design, _laws
from rcmqp.controllers import CONTROLLERS
from rcmqp.errors import OptionError, RunFileError
from rcmqp.experiments.study.plan import Law
from rcmqp.experiments.trial.design import Design, file_sha256, orders
from rcmqp.experiments.trial.people import Folder, Person, checked_id
from rcmqp.experiments.trial.questions import EXPERIENCE, checked_after, checked_before
from rcmqp.experiments.trial.task import read_task, scenarios_task, with_task
from rcmqp.files import _part
from rcmqp.live.messages import Malformed, Said, parse
from rcmqp.live.page import after_page, before_page
from rcmqp.references.operators.camera_task import CameraTask, Goals
from rcmqp.references.paths import Search
from rcmqp.runs.loading import load_scenario

OWN = """
import dataclasses
from rcmqp import load_scenario
def scenario(arm="panda", **options):
    return dataclasses.replace(load_scenario("camera_task", arm, **options), duration=20.0)
"""
NONE = dict.fromkeys(EXPERIENCE, 0)
LAWS = (Law("hierarchical_qp"), Law("dual_quaternion"), Law("vfi_qp"))
TASK = scenarios_task(load_scenario("camera_task", "panda"))


def design(**changes: Any) -> Design:
    return dataclasses.replace(Design("camera_task", "panda", LAWS, TASK), **changes)


# The order of the conditions ------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6])
def test_each_condition_is_at_each_place_and_follows_each_other_equally_often(count: int) -> None:
    rows = orders(count)
    for place in zip(*rows, strict=True):
        assert Counter(place) == dict.fromkeys(range(count), len(rows) // count)
    follows = Counter(pair for row in rows for pair in itertools.pairwise(row))
    assert len(follows) == count * (count - 1)
    assert len(set(follows.values())) <= 1


def test_participants_of_a_group_go_through_all_orders_in_turn(tmp_path: Path) -> None:
    folder, chosen = Folder(tmp_path), design()
    rows = {0: [], 3: []}  # type: dict[int, list[int]]
    for _ in range(6):
        for games in rows:
            with folder.sitting() as name:
                person = folder.add(name, NONE | {"games": games}, chosen)
            rows[games].append(person.row)
    assert all(sorted(of) == list(range(6)) for of in rows.values())
    together = [row for pair in zip(*rows.values(), strict=True) for row in pair]
    assert sorted(together[:6]) == list(range(6))  # whatever their group


def test_two_people_who_answer_at_once_have_different_orders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep, both = Folder.keep_person, threading.Barrier(2)

    def slow(self: Folder, person: Person) -> None:
        time.sleep(0.3)
        keep(self, person)

    def add(name: str) -> Person:
        both.wait()
        return Folder(tmp_path).add(name, NONE, design())

    monkeypatch.setattr(Folder, "keep_person", slow)
    with ThreadPoolExecutor(2) as pool:
        people = list(pool.map(add, ("P01", "P02")))
    assert {person.row for person in people} == {0, 1}


# Participants ---------------------------------------------------------------------------------


def test_experience_decides_the_group_and_novices_alone_practise(tmp_path: Path) -> None:
    folder = Folder(tmp_path)
    novice = folder.add("P01", NONE, design())
    for name in EXPERIENCE:
        assert folder.add("P02", NONE | {name: 1}, design()).group == "experienced"
    assert (novice.group, novice.practised) == ("novice", False)
    assert folder.person("P02") is not None
    assert not any(person.practised for person in map(folder.person, ("P01", "P02")) if person)
    assert folder.person("P01") == novice


@pytest.mark.parametrize("name", ["Ada", "P1 ", "../P1", "p01", "", "P", "P1234567", "ABCD1"])
def test_a_name_is_no_identifier(name: str) -> None:
    with pytest.raises(OptionError, match="three capital letters"):
        checked_id(name)


def test_delete_removes_all_of_a_participant_and_nothing_else(tmp_path: Path) -> None:
    folder = Folder(tmp_path)
    for name in ("P01", "P011", "P02"):
        folder.add(name, NONE, design())
        folder.keep_notes(name, 1, {"answers": None})
        folder.run_file(name, 1).write_bytes(b"run")
    (tmp_path / "figures").mkdir()
    summed_up = ["figures/P01-1_fig6_errors.png", "figures/groups_1.png", "answers.csv"]
    for name in (*summed_up, "figures/P011-1_fig6_errors.png"):
        (tmp_path / name).write_text("of all")
    for name in ("people/P01.json", "trials/P01-1.json", "trials/P01-1.h5"):
        _part(tmp_path / name).write_bytes(b"killed")
    with pytest.raises(SystemExit, match="0"):
        main(["trial", "--out", str(tmp_path), "--delete", "P01"])
    assert folder.identifiers() == ["P011", "P02"]
    assert {file.name for file in (tmp_path / "people").iterdir()} == {"P011.json", "P02.json"}
    names = sorted(file.name for file in (tmp_path / "trials").iterdir())
    assert [file.name for file in (tmp_path / "figures").iterdir()] == ["P011-1_fig6_errors.png"]
    assert not (tmp_path / "answers.csv").exists()
    assert names == ["P011-1.h5", "P011-1.json", "P02-1.h5", "P02-1.json"]
    with pytest.raises(OptionError, match="no participant P01; it has P011, P02"):
        folder.delete("P01")


def test_the_next_identifier_is_never_one_of_somebody_before(tmp_path: Path) -> None:
    folder = Folder(tmp_path)
    for name in ("P01", "P02", "P09", "XY12"):
        folder.add(name, NONE, design())
    for name in ("P09", "P02"):
        folder.delete(name)
    with folder.sitting() as name:
        assert name == "P10"
    assert (tmp_path / "highest_number.txt").read_text() == "9\n"


def test_no_two_sittings_have_the_same_participant(tmp_path: Path) -> None:
    folder, other = Folder(tmp_path), Folder(tmp_path)
    with folder.sitting() as first, other.sitting() as second:
        assert (first, second) == ("P01", "P02")
        folder.add("P01", NONE, design())
        with pytest.raises(OptionError, match="P01 is with another"), other.sitting("P01"):
            pass
        with pytest.raises(OptionError, match="P01 is with another"):
            other.delete("P01")
    with other.sitting("P01") as name:  # what is left of a sitting that was over holds nobody
        assert name == "P01"
    assert folder.delete("P01") == 2


@pytest.mark.parametrize(
    "changes",
    [
        *({"row": 1.0}, {"row": -1}, {"row": True}, {"practised": 1}, {"group": []}, {"age": 40}),
        *({"before": []}, {"before": NONE | {"games": 4}}, {"before": {"games": 0}}),
    ],
)
def test_a_participant_of_wrong_types_or_ranges_is_refused_by_name(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    folder = Folder(tmp_path)
    person = folder.add("P01", NONE, design())
    file = tmp_path / "people" / "P01.json"
    file.write_text(json.dumps(dataclasses.asdict(person) | changes))
    with pytest.raises(RunFileError, match=r"P01\.json: is damaged"):
        folder.person("P01")


@pytest.mark.parametrize(
    "changes",
    [
        *({"attempts": "1"}, {"number": 2}, {"finished": 1}, {"faults": ""}, {"device": [1]}),
        *({"law": 3}, {"law": "[1]"}, {"law": "[1, 2, []]"}, {"answers": 3}, {"answers": {}}),
    ],
)
def test_notes_of_wrong_types_or_ranges_are_refused_by_name(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    folder = Folder(tmp_path)
    folder.add("P01", NONE, design())
    notes = {"number": 1, "law": LAWS[0].to_json(), "attempts": 1, "faults": [], "finished": None}
    folder.keep_notes("P01", 1, notes | {"answers": None})
    assert folder.notes("P01", 1) is not None
    folder.keep_notes("P01", 1, notes | {"answers": None} | changes)
    with pytest.raises(RunFileError, match=r"P01-1\.json: is damaged"):
        folder.notes("P01", 1)


@pytest.mark.parametrize("text", ["", "[]", '{"identifier": "P01"}', '{"group": "nobody"}'])
def test_a_damaged_file_of_a_participant_is_refused_by_name(tmp_path: Path, text: str) -> None:
    folder = Folder(tmp_path)
    folder.add("P01", NONE, design())
    (tmp_path / "people" / "P01.json").write_text(text)
    with pytest.raises(RunFileError, match=r"P01\.json"):
        folder.person("P01")


# The design -----------------------------------------------------------------------------------


def test_a_design_is_kept_and_another_one_in_its_folder_is_refused(tmp_path: Path) -> None:
    chosen = design(consent="You may stop at any time.", practice=30.0)
    chosen.keep(tmp_path)
    assert Design.load(tmp_path) == chosen
    chosen.keep(tmp_path)
    with pytest.raises(OptionError, match="another practice"):
        design(consent="You may stop at any time.").keep(tmp_path)


def test_a_scenario_that_has_changed_since_the_study_began_is_refused(tmp_path: Path) -> None:
    file, changed = tmp_path / "own.py", "is not what it was when the study began"
    file.write_text(OWN)
    chosen = _design(str(file), "panda", None, None, None, None, {})
    chosen.keep(tmp_path)
    kept = Design.load(tmp_path).with_files(str(file), [])
    kept.made(kept.laws[0])
    chosen.keep(tmp_path)
    file.write_text(OWN.replace("20.0", "30.0"))
    with pytest.raises(OptionError, match=changed):
        kept.made(kept.laws[0])
    with pytest.raises(OptionError, match=changed):
        _design(str(file), "panda", None, None, None, None, {}).keep(tmp_path)
    with pytest.raises(SystemExit, match="1"):
        main(["trial", "--out", str(tmp_path), "--no-open"])


def test_a_folder_without_a_study_is_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="rcmqp trial camera_task --out"):
        Design.load(tmp_path)
    (tmp_path / "study.json").write_text("{}")
    with pytest.raises(OptionError, match="is damaged"):
        Design.load(tmp_path)


def test_each_controller_has_a_period_or_all_have_one() -> None:
    settings = ["hierarchical_qp", "dual_quaternion"]

    def periods(*given: float) -> list[float]:
        return [law.period for law in _laws(settings, list(given))[0]]

    assert periods() == [1e-3, 8e-3]
    assert periods(2e-3) == [2e-3, 2e-3]
    assert periods(2e-3, 4e-3) == [2e-3, 4e-3]
    with pytest.raises(OptionError, match="3 times for 2 controllers"):
        periods(1e-3, 2e-3, 3e-3)


def test_a_law_of_ones_own_is_kept_and_a_changed_one_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="0"):
        main(["new", "law", "my_own_law"])
    file = tmp_path / "my_own_law.py"
    settings = ["my_own_law.py:MyOwnLaw:gain=30", "hierarchical_qp"]
    chosen = _design("camera_task", "panda", settings, [4e-3], None, None, {})
    chosen.keep(tmp_path)
    chosen.keep(tmp_path)
    CONTROLLERS.pop("my_own_law")  # another process does not know it
    kept = Design.load(tmp_path)
    assert "my_own_law" not in CONTROLLERS
    assert kept == chosen
    assert [str(law) for law in kept.laws] == [
        "my_own_law, 4 ms, gain = 30.0",
        "hierarchical_qp, 4 ms",
    ]
    with pytest.raises(OptionError, match=r"not run: give it again, with -c my_own_law\.py:MyOwn"):
        kept.with_files(None, [])
    with pytest.raises(OptionError, match="gain=20 is not a controller of this study"):
        kept.with_files(None, ["my_own_law.py:MyOwnLaw:gain=20"])
    kept = kept.with_files(None, ["./my_own_law.py"])
    assert [kept.setting(law) for law in kept.laws] == ["./my_own_law.py", "hierarchical_qp"]
    assert kept.laws[0].controller(kept.made(kept.laws[0])).options["gain"] == 30.0
    kept.keep(tmp_path)  # in another place, the file is the same
    file.write_text(file.read_text() + "\n# changed\n")
    with pytest.raises(OptionError, match=r"my_own_law\.py is not what it was"):
        kept.made(kept.laws[0])
    file.unlink()
    with pytest.raises(OptionError, match="cannot be read"):
        kept.made(kept.laws[1])


def trap(file: Path) -> Path:
    """A program that leaves a file beside itself when it is run; that file."""
    mark = file.with_suffix(".ran")
    file.write_text(f"open({str(mark)!r}, 'w').close()\n", encoding="utf-8")
    return mark


def test_no_file_that_a_folder_names_is_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, law, own = tmp_path / "down", tmp_path / "law.py", tmp_path / "own.py"
    folder.mkdir()
    marks = trap(law), trap(own)
    data = json.loads(design().to_json())
    laws = [json.dumps([name, 1e-3, []]) for name in ("x", "vfi_qp")]
    strange = {
        "law": {"laws": laws, "own_laws": {"x": [str(law), file_sha256(str(law))]}},
        "scenario": {"scenario": str(own)},
        "name": {"laws": [json.dumps([str(law), 1e-3, []])]},
    }
    said = {"law": "with -c", "scenario": "the scenario of this study is a program", "name": "is"}
    for what, changes in strange.items():
        (folder / "study.json").write_text(json.dumps(data | changes), encoding="utf-8")
        hand = ["--hand", str(tmp_path / "h.csv")]
        for command in (["study", str(folder)], ["study", str(folder), *hand]):
            with pytest.raises(SystemExit, match="1"):
                main(command)
        capsys.readouterr()
        with pytest.raises(SystemExit, match="1"):
            main(["trial", "--out", str(folder), "--no-open"])
        assert said[what] in " ".join(capsys.readouterr().err.split())
        assert not any(mark.exists() for mark in marks)


def test_a_typed_file_that_is_not_the_studys_is_refused_before_it_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    law = tmp_path / "law.py"
    mark = trap(law)
    data = json.loads(design().to_json()) | {"own_laws": {"vfi_qp": [str(law), "00"]}}
    (tmp_path / "study.json").write_text(json.dumps(data), encoding="utf-8")
    for more in ([], ["--arm", "panda"]):
        with pytest.raises(SystemExit, match="1"):
            main(["trial", "-c", str(law), *more, "--out", str(tmp_path), "--no-open"])
        assert "another file of a controller" in " ".join(capsys.readouterr().err.split())
    assert not mark.exists()


def test_a_study_does_not_say_in_which_folder_a_file_of_a_controller_is(tmp_path: Path) -> None:
    (tmp_path / "law.py").write_text("", encoding="utf-8")
    setting = f"{tmp_path / 'law.py'}:MyLaw"
    text = design(own_laws={"mine": (setting, file_sha256(setting))}).to_json()
    assert "law.py:MyLaw" in text
    assert str(tmp_path) not in text


@pytest.mark.parametrize("laws", [(), (Law(), Law())])
def test_controllers_are_given_and_differ(laws: tuple[Law, ...]) -> None:
    with pytest.raises(OptionError, match="each given once"):
        design(laws=laws)


# The task -------------------------------------------------------------------------------------


def test_the_papers_task_is_that_of_the_simulated_operators() -> None:
    task = CameraTask()
    assert TASK.places == task.targets
    assert TASK.spheres == task.spheres
    assert TASK.obstacle == task.obstacle
    assert TASK.tolerance == 1e-3
    assert "within 1 mm" in TASK.instructions
    made = with_task(load_scenario("camera_task", "panda"), TASK)
    assert_allclose(
        made.obstacles[0].centre,
        load_scenario("camera_task", "panda").obstacles[0].centre,
        rtol=0,
        atol=1e-12,
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("places = [[0, 0, 0.13]]", "has no spheres"),
        ("size = 3", "it may have places, spheres"),
        ("places = 3\nspheres = []", "places = 3, it must be a list"),
        ("x = [", "cannot be read"),
        ("places = [[0, 0, -0.1]]\nspheres = [{centre = [0, 0, 0.1], radius = 0.01}]", "inside"),
        ("places = [[0, 0, 0.1]]\nspheres = [{centre = [0, 0, 0.1], radius = -1}]", "radius"),
    ],
)
def test_a_task_file_with_a_mistake_is_refused_in_words(
    tmp_path: Path, text: str, said: str
) -> None:
    file = tmp_path / "task.toml"
    file.write_text(text)
    with pytest.raises(OptionError, match=said) as error:
        read_task(file)
    assert str(file) in str(error.value)


def test_a_place_that_the_trocar_does_not_allow_is_refused_before_anybody_comes() -> None:
    base = load_scenario("camera_task", "panda")
    for place in ((0.0, 0.0, 0.6), (0.2, 0.0, 0.05)):
        with pytest.raises(OptionError, match="the trocar allows"):
            with_task(base, dataclasses.replace(TASK, places=(place,)))


def test_places_are_reached_one_after_the_other() -> None:
    goals = Goals(np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.2]]), 1e-3)
    for t, z in enumerate([0.2, 0.0985, 0.0995, 0.1, 0.2005, 0.2]):
        goals.see(float(t), np.array([0.0, 0.0, z]))
    assert goals.reached == [2.0, 4.0]
    assert goals.done
    assert not Goals(np.zeros((0, 3)), 1.0).done


def test_instructions_stay_text_on_a_page(tmp_path: Path) -> None:
    assert "<script>alert" not in before_page("<script>alert(1)</script>")
    assert "agree" in before_page("")
    assert "task 2 of 3" in after_page(2, 3)


# Answers --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"consent": False}, "consent"),
        ({"games": 4}, "whole number 0 to 3"),
        ({"games": True}, "whole number"),
        ({"name": "Ada"}, "the questions are"),
    ],
)
def test_answers_before_that_are_not_allowed_are_refused(
    changes: dict[str, Any], said: str
) -> None:
    with pytest.raises(OptionError, match=said):
        checked_before({**NONE, "consent": True, **changes})


def test_answers_after_are_1_to_4_and_a_comment() -> None:
    given = {"ease": 1, "followed": 4, "comment": " good "}
    assert checked_after(given) == {"ease": 1, "followed": 4, "comment": "good"}
    half = json.loads(r'"half \ud83d, whole \ud83d\ude00"')
    assert checked_after(given | {"comment": half})["comment"] == "half ?, whole \U0001f600"
    for wrong in ({"ease": 0}, {"followed": 5}, {"comment": 3}, {"comment": "x" * 501}):
        with pytest.raises(OptionError, match=r"must be|comment"):
            checked_after(given | wrong)


def test_a_page_says_start_break_and_answers_and_nothing_else() -> None:
    said = parse(json.dumps({"kind": "answers", "values": {"ease": 1, "comment": "x"}}))
    assert said == Said("answers", {"ease": 1, "comment": "x"})
    assert parse('{"kind": "start"}') == Said("start", {})
    for text in ('{"kind": "start", "x": 1}', '{"kind": "answers", "values": [1]}'):
        with pytest.raises(Malformed):
            parse(text)
    many = {str(i): 1 for i in range(11)}
    with pytest.raises(Malformed):
        parse(json.dumps({"kind": "answers", "values": many}))


def test_a_search_shows_its_places_and_stays_where_it_is() -> None:
    search = Search(TASK.places, TASK.spheres)
    assert search.targets(0.1) == TASK.places
    assert search.command(3.0, 0.1) == search.command(0.0, 0.1)
