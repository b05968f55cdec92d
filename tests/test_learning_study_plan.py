"""What a study file asks for, key by key: bounds at their edges, what stands above what, and what is refused."""

import math
import re

import pytest

from learning.networks.m4gn import M4GNConfig
from learning.study.plan import FOLDER, Data, Trial, family_of, load_plan, slug, study_file
from physics.schema import InputError

ROW = '[[row]]\nname = "one"\n'
DATA = 'data = { family = "demo", train = 1 }\n'
PLAIN = f"{ROW}[check]\n{DATA}"


def planned(folder, text, size="check", name="study"):
    (folder / f"{name}.toml").write_text(text)
    return load_plan(folder / f"{name}.toml", size)


def test_a_study_of_one_row_has_one_seed_the_test_split_and_no_words(tmp_path):
    plan = planned(tmp_path, PLAIN)
    assert (plan.title, plan.about, plan.source, plan.size, plan.seeds) == ("a study", "", "", "check", 1)
    assert plan.tests == (Trial("test", "data"),) and [row.name for row in plan.rows] == ["one"]
    table, made = plan.sets["data"]
    assert made == Data(family="demo", train=1, valid=0, test=1, seed=0) and table["name"] == "demo"
    assert made.splits == {"train": 1, "test": 1}
    assert plan.rows[0].published == {"test": {}}
    words = planned(tmp_path, 'title = " A "\nabout = "\\nB\\n"\nsource = "C"\n' + PLAIN)
    assert (words.title, words.about, words.source) == ("A", "B", "C")


@pytest.mark.parametrize("key, least, most", [("train", 1, 100_000), ("valid", 0, 100_000), ("test", 1, 100_000), ("seed", 0, None)])
def test_how_many_of_each_has_bounds(tmp_path, key, least, most):
    def made(value):
        numbers = {"train": 1, key: value}
        said = ", ".join(f"{name} = {number}" for name, number in numbers.items())
        return getattr(planned(tmp_path, f'{ROW}[check]\ndata = {{ family = "demo", {said} }}\n').sets["data"][1], key)

    for value in (least, most or 10**9):
        assert made(value) == value
    for value in (least - 1, *([most + 1] if most else [])):
        with pytest.raises(InputError, match=rf"check\.data\.{key}"):
            made(value)
    assert Data(family="demo", train=0, valid=2).splits == {"valid": 2, "test": 1}


@pytest.mark.parametrize("seeds, fine", [("1", True), ("100", True), ("0", False), ("101", False), ("true", False), ("2.0", False)])
def test_there_are_from_one_to_a_hundred_seeds(tmp_path, seeds, fine):
    text = f"{PLAIN}seeds = {seeds}\n"
    if fine:
        assert planned(tmp_path, text).seeds == int(seeds)
    else:
        with pytest.raises(InputError, match=r"check\.seeds = .*: must be a whole number from 1 to 100"):
            planned(tmp_path, text)


@pytest.mark.parametrize("text, said", [
    ("base = 3\n" + PLAIN, "base must be a table"),
    ("check = 3\n" + ROW, "check must be a table"),
    (PLAIN + "[grid]\nnoise = []\n", "grid: must be a table of lists of values"),
    (PLAIN + "[grid]\nnoise = 0.1\n", "grid: must be a table of lists of values"),
    (PLAIN + "[grid]\nnoise = [0.1]\nsteps = 2\n", "grid: must be a table of lists of values"),
    (f"[check]\n{DATA}", "row: at least one is needed"),
    (f'{ROW}[[row]]\nname = "one "\n[check]\n{DATA}', "each with a name of its own"),  # their folders would be the same
    (f"row = 3\n[check]\n{DATA}", r"row: must be tables \[\[row\]\], each with a name"),
    (f"row = [3]\n[check]\n{DATA}", r"row: must be tables \[\[row\]\], each with a name"),
    (f"[[row]]\nname = 3\n[check]\n{DATA}", r"row: must be tables \[\[row\]\], each with a name"),
    (f"[[row]]\n[check]\n{DATA}", r"row: must be tables \[\[row\]\], each with a name"),
    (f"{ROW}[check]\n", r"check\.data: missing"),
    (f"{ROW}[check]\ndata = 2\n", r"check\.data: missing"),
    (f"{ROW}published = 3\n[check]\n{DATA}", r"row\[0\]\.published: must be a table"),
    (f"{ROW}published = {{ mc = [1, 2, 3] }}\n[check]\n{DATA}", r"row\[0\]\.published\.mc = .*a number, or a mean and a deviation"),
    (f"{ROW}published = {{ mc = [1] }}\n[check]\n{DATA}", r"row\[0\]\.published\.mc = .*a number, or a mean and a deviation"),
    (f'{ROW}published = {{ mc = [1, "2"] }}\n[check]\n{DATA}', r"row\[0\]\.published\.mc = .*a number, or a mean and a deviation"),
    (f"{ROW}sett = {{ steps = 2 }}\n[check]\n{DATA}", "sett: unknown key; did you mean 'set'"),
    (f'{PLAIN}[[test]]\nname = "t"\nsett = {{ steps = 2 }}\n', "sett: unknown key; did you mean 'set'"),
    (f'{PLAIN}[[test]]\nname = "t"\nfamily = "demos"\n', r"test\[0\]\.family = 'demos': must be one of .*did you mean 'demo'"),
    (f'{ROW}{PLAIN}[grid]\nnoise = [1.0, -1.0]\n', r"row\[0\] \(one, noise -1\.0\): noise = -1")])
def test_what_is_no_study_is_refused_in_one_line(tmp_path, text, said):
    with pytest.raises(InputError, match=said) as caught:
        planned(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 'study.toml'}: ") and "\n" not in str(caught.value)


def test_a_size_is_one_of_three_and_one_that_the_study_has(tmp_path):
    with pytest.raises(InputError, match=r"^--size big: must be one of check, small, paper$"):
        planned(tmp_path, PLAIN, "big")
    with pytest.raises(InputError, match="small: no such size in this study; it has check$"):
        planned(tmp_path, PLAIN, "small")
    with pytest.raises(InputError, match="small: no such size in this study; it has none$"):
        planned(tmp_path, ROW, "small")


def test_a_study_is_a_file_or_the_name_of_one_of_the_package():
    assert study_file("nowhere/mine.toml").name == "mine.toml"
    assert study_file("main") == FOLDER / "main.toml"
    with pytest.raises(InputError, match=r"^no study 'mainn': give a \.toml file or one of .*main.*did you mean 'main'"):
        study_file("mainn")


def test_a_chain_of_five_studies_ends_and_one_of_six_is_taken_for_a_ring(tmp_path):
    for number in range(6):
        (tmp_path / f"s{number}.toml").write_text(f'like = "s{number - 1}"\n{ROW}' if number else PLAIN)
    assert load_plan(tmp_path / "s4.toml", "check").sets["data"][1].train == 1
    with pytest.raises(InputError, match=r"s5\.toml: like = 's0': a chain of studies that does not end"):
        load_plan(tmp_path / "s5.toml", "check")


def test_a_study_has_of_the_one_it_is_like_what_it_has_not_itself(tmp_path):
    """Sizes and base are joined key by key, tests are one list or the other, rows, grid and words are its own alone."""
    planned(tmp_path, 'title = "T"\nabout = "A"\n[base]\nnoise = 0.5\nsteps = 7\n[grid]\nbatch_size = [1, 2]\n[[test]]\nname = "old"\n'
            + PLAIN + "seeds = 3\n", name="first")
    plan = planned(tmp_path, 'like = "first"\n[base]\nsteps = 9\n[[row]]\nname = "own"\n[small]\n' + DATA, name="second")
    assert (plan.title, plan.about, plan.seeds, [row.name for row in plan.rows]) == ("a study", "", 3, ["own"])
    assert (plan.rows[0].config.noise, plan.rows[0].config.steps) == (0.5, 9)
    assert [test.name for test in plan.tests] == ["old"]
    assert load_plan(tmp_path / "second.toml", "small").seeds == 1
    assert planned(tmp_path, f'like = "first"\n{ROW}[[test]]\nname = "new"\n', name="third").tests == (Trial("new", "data"),)


def test_a_study_may_be_like_one_of_the_package_where_none_lies_beside_it(tmp_path):
    assert planned(tmp_path, f'like = "main"\n{ROW}').sets == load_plan("main", "check").sets


def test_what_stands_above_what_in_a_config(tmp_path):
    """base, the size, the row, the grid; keys of the network above those of its kind, and these above those of all kinds."""
    text = ('[base]\nnoise = 0.1\nsegments = 10\nbatch_size = 10\nsteps = 10\n[[row]]\nname = "r"\n'
            "set = { batch_size = 30, steps = 30, network = { message_steps = 6 } }\n[grid]\nsteps = [40]\n"
            "[check]\nset = { segments = 20, batch_size = 20, steps = 20 }\n"
            "networks = { all = { hidden = 4, message_steps = 4, transformer_layers = 4 }, m4gn = { transformer_layers = 5, "
            "message_steps = 5 }, gcn = { layers = 2 } }\n") + DATA
    config = planned(tmp_path, text).rows[0].config  # without a kind it is M4GN
    assert (config.noise, config.segments, config.batch_size, config.steps) == (0.1, 20, 30, 40)
    assert config.network == M4GNConfig(hidden=4, transformer_layers=5, message_steps=6)


def test_a_grid_has_every_combination_the_last_key_the_quickest(tmp_path):
    rows = planned(tmp_path, PLAIN + '[grid]\nsteps = [2, 3]\n"network.hidden" = [4, 8, 16]\n"network.heads" = [2]\n').rows
    assert [(row.config.steps, row.config.network.hidden) for row in rows] == [(s, h) for s in (2, 3) for h in (4, 8, 16)]
    assert {row.config.network.heads for row in rows} == {2}
    assert [row.name for row in rows][:2] == ["one, steps 2, hidden 4, heads 2", "one, steps 2, hidden 8, heads 2"]


def test_a_test_on_another_family_has_its_trajectories_alone_changed_as_those_of_the_data(tmp_path):
    text = ROW + '[check]\ndata = { family = "demo", train = 3, valid = 2, test = 4, seed = 5, set = { steps = { count = 7 } } }\n'
    plan = planned(tmp_path, text + '[[test]]\nname = "here"\nset = { segments = 9 }\n[[test]]\nname = "there"\nfamily = "beam-small"\n'
                   "set = { tau = 0.5 }\n")
    assert plan.tests == (Trial("here", "data", {"segments": 9}), Trial("there", "beam-small", {"tau": 0.5}))
    assert list(plan.sets) == ["data", "beam-small"]
    table, made = plan.sets["beam-small"]
    assert made == Data(family="beam-small", train=0, valid=0, test=4, seed=5)
    assert (table["name"], table["steps"]["count"], plan.sets["data"][0]["steps"]["count"]) == ("beam-small", 7, 7)
    family = family_of(table, tmp_path / "sets" / "it.toml")
    assert family.name == "beam-small" and (tmp_path / "sets" / "it.toml").exists()


def test_published_figures_are_of_the_first_test_or_of_the_one_that_is_named(tmp_path):
    """A number alone has no deviation; a test's name that stands beside a number is a figure of the first."""
    text = (PLAIN.replace('"one"\n', '"one"\npublished = { mc = 1, ar = [2, 3.5], second = { mc = 4 }, third = 5 }\n')
            + "".join(f'[[test]]\nname = "{name}"\n' for name in ("first", "second", "third")))
    published = planned(tmp_path, text).rows[0].published
    assert list(published) == ["first", "second"] and list(published["first"]) == ["mc", "ar", "third"]
    assert published["first"]["ar"] == (2.0, 3.5) and published["first"]["mc"][0] == 1.0 and math.isnan(published["first"]["mc"][1])
    assert published["first"]["third"][0] == 5.0 and published["second"]["mc"][0] == 4.0


@pytest.mark.parametrize("name, folder", [("M4GN", "M4GN"), ("as / trained on", "as-trained-on"), (" -a b- ", "a-b"), ("é", "row"),
                                          ("1.5+2-x", "1.5+2-x"), ("", "row"), ("a, steps 2", "a-steps-2")])
def test_a_name_as_a_folder(name, folder):
    assert slug(name) == folder and not re.search("[^A-Za-z0-9.+-]", folder)
