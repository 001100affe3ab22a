"""The study file: lines, allowed values, confinement to its folder, and published documents that are current."""

from pathlib import Path

import pytest

from flexplant.errors import StudyError
from flexplant.study import reference
from flexplant.study.examples import example_study
from flexplant.study.load import load_study

REPOSITORY = Path(__file__).parents[2]
GOOD = """\
title: Two beams
components:
  a: {file: a.npz}
  b: {file: b.npz}
connections:
  - {a: a, b: b, nodes: [3]}
plant:
  inputs: [a.1.1]
  outputs: [b.4.1]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the files that GOOD names."""
    for name in ("a.npz", "b.npz"):
        (tmp_path / name).write_bytes(b"")
    return tmp_path


def problem(folder: Path, text: str) -> str:
    """What load_study says about a text."""
    (folder / "study.yaml").write_text(text)
    with pytest.raises(StudyError) as caught:
        load_study(folder / "study.yaml")
    return str(caught.value)


def changed(old: str, new: str) -> str:
    """GOOD with one change, which must be there."""
    assert old in GOOD
    return GOOD.replace(old, new)


def test_a_good_file_loads_with_its_values(folder):
    (folder / "study.yaml").write_text(GOOD)
    study = load_study(folder / "study.yaml")
    assert study.title == "Two beams"
    assert study.connections[0].nodes == [3]
    assert study.method == "dual"
    assert study.damping is None, "damping has no default"


@pytest.mark.parametrize(
    ("old", "new", "line", "said"),
    [
        ("title: Two beams", "titel: Two beams", 1, "did you mean 'title'"),
        ("connections:", "connection:", 5, "allowed here: title, statement, components, connections"),
        ("a.npz}", "a.npz, unit: SI}", 3, "did you mean 'units'"),
        ("nodes: [3]", "nodes: [3], frame: c", 6, "'a', 'b' or 'system'"),
        ("nodes: [3]", "nodes: [three]", 6, "node ids"),
        ("nodes: [3]", "directions: '12'", 6, "give nodes"),
        ("nodes: [3]", "nodes: [3], pairs: [[3, 4]]", 6, "not both"),
        ("nodes: [3]", "nodes: [3], directions: '127'", 6, "digits 1-6"),
        ("plant:", "method: trial\nplant:", 7, "'dual' or 'primal'"),
        ("plant:", "damping: {ratio: -0.1}\nplant:", 7, "damping ratio"),
        ("plant:", "plant:\n  max_frequency_hz: fast", 8, "number"),
        ("plant:", "response: {from_hz: 5, to_hz: 2}\nplant:", 7, "must be larger than from_hz"),
        ("  outputs: [b.4.1]\n", "", 7, "'outputs' is missing"),
        ("a.npz", "missing.npz", 3, "no file 'missing.npz'"),
        ("a: a, b: b", "a: a, b: c", 6, "no component 'c'"),
        ("a.npz}", "a.npz, reduce: {boundary: [[1, '1']], n_modes: 3, size: 9}}", 3, "size goes with max_frequency_hz alone"),
        ("[a.1.1]", "[aa.1.1]", 8, "no component 'aa'"),
    ],
)
def test_every_mistake_names_its_line_and_what_is_allowed(folder, old, new, line, said):
    text = problem(folder, changed(old, new))
    assert f"study.yaml, line {line}: " in text
    assert said in text
    assert "\n" not in text


def test_several_mistakes_are_told_together_in_the_order_of_the_file(folder):
    text = changed("title: Two beams", "titel: Two beams") + "method: trial\n"
    lines = problem(folder, text).splitlines()
    assert [int(line.split("line ")[1].split(":")[0]) for line in lines] == [1, 10]


@pytest.mark.parametrize("path", ["../a.npz", "/etc/hostname", "link.npz", "sub/../../a.npz"])
def test_files_outside_the_folder_need_permission(tmp_path, path):
    folder = tmp_path / "inner"
    (folder / "sub").mkdir(parents=True)
    (tmp_path / "a.npz").write_bytes(b"")
    for name in ("a.npz", "b.npz"):
        (folder / name).write_bytes(b"")
    (folder / "link.npz").symlink_to(tmp_path / "a.npz")
    assert "outside the study's folder" in problem(folder, changed("a.npz", path))
    assert load_study(folder / "study.yaml", allow_outside=True).components["a"].file == path


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"title: [1, 2\nplant: 3", "line 2: not valid YAML"),
        (b"title: a\ntitle: b", "line 2: key 'title' is given twice (first in line 1)"),
        (b"title: !!python/object:os.system [ls]", "line 1: tag"),
        (b"- 1\n- 2", "has keys such as title"),
        (b"", "has keys such as title"),
        (b"\xff\xfe\x00\x01", "not a text file"),
        (b"a: " + b"[" * 1000, "not valid YAML"),
        (b"a: " + b"x" * 3_000_000, "too large"),
    ],
)
def test_files_that_are_no_study_are_refused_in_one_line(tmp_path, content, said):
    path = tmp_path / "study.yaml"
    path.write_bytes(content)
    with pytest.raises(StudyError) as caught:
        load_study(path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_alias_bomb_is_stopped(tmp_path):
    levels = ["l0: &l0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    levels += [f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 10)}]" for i in range(1, 12)]
    (tmp_path / "study.yaml").write_text("\n".join(levels))
    with pytest.raises(StudyError, match="is this the right file"):
        load_study(tmp_path / "study.yaml")


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(StudyError, match=r"none\.yaml: cannot read the study file"):
        load_study(tmp_path / "none.yaml")


def test_numbers_as_engineers_write_them(folder):
    (folder / "study.yaml").write_text(GOOD + "  drop_tolerance: 5e-6\n  max_frequency_hz: 1_000\n")
    plant = load_study(folder / "study.yaml").plant
    assert plant.drop_tolerance == 5e-6
    assert plant.max_frequency_hz == 1000


def test_the_starter_study_is_valid_but_for_its_files(tmp_path):
    for name in ("bus.op4", "optic.op4"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "study.yaml").write_text(reference.STARTER)
    assert set(load_study(tmp_path / "study.yaml").components) == {"bus", "optic"}
    uncommented = "\n".join(
        line.replace("# ", "", 1) if line.startswith(("# line_of_sight", "#   ")) else line
        for line in reference.STARTER.splitlines()
    )
    (tmp_path / "study.yaml").write_text(uncommented)
    assert load_study(tmp_path / "study.yaml").line_of_sight is not None


def test_the_example_study_is_valid():
    study = load_study(example_study("shocksat"))
    assert study.damping is not None
    assert study.damping.ratio == 0.005
    with pytest.raises(StudyError, match="Did you mean 'shocksat'"):
        example_study("shocksat2")


def test_published_schema_and_reference_page_are_current():
    hint = "; refresh it with: flexplant schema > docs/study.schema.json; flexplant schema --markdown > docs/study-file.md"
    assert (REPOSITORY / "docs/study.schema.json").read_text() == reference.json_schema(), "schema" + hint
    assert (REPOSITORY / "docs/study-file.md").read_text() == reference.markdown(), "page" + hint
