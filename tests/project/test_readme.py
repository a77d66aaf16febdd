"""README and docs are true: their Python runs anywhere, commands exist, links and scores hold."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from pacnet.cli import make_parser

PROJECT = Path(__file__).parents[2]
PAGES = (
    *(PROJECT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")),
    PROJECT / "lerobot_policy_pacnet/README.md",
    *sorted((PROJECT / "docs").glob("*.md")),
)
TEXTS = {path.relative_to(PROJECT).as_posix(): path.read_text() for path in PAGES}
README, INDEX = TEXTS["README.md"], TEXTS["docs/index.md"]
EXPERIMENTS, BEHAVIOURS = TEXTS["docs/experiments.md"], TEXTS["docs/behaviours.md"]
PERFORMANCE, BENCHMARKS = TEXTS["docs/performance.md"], TEXTS["docs/benchmarks.md"]
ROBOTS = ("| so101 ", "| piper ", "| pusht ")
KEYS = ("wf", "tight", "energy")
MODULES = sorted(
    set(re.findall(r"python -m ((?:train|benchmarks)\.[a-z]\w*)", "".join(TEXTS.values())))
)
_SNIPPET = re.compile(r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```)?", re.DOTALL | re.MULTILINE)
SNIPPETS = {  # of each page: code, and what the page says that it prints
    name: _SNIPPET.findall(text)
    for name, text in TEXTS.items()
    if "```python" in text and name != "docs/lerobot.md"  # whose commands belong in between
}
_RUN = """
import contextlib, io, json, sys
printed = []
for number, code in enumerate(json.load(sys.stdin)):
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(compile(code, f"snippet {number}", "exec"), {"__name__": "__main__"})
    printed.append(out.getvalue())
print(json.dumps(printed))
"""


@pytest.mark.parametrize("page", SNIPPETS)
def test_the_python_of_a_page_runs_in_any_folder_and_prints_what_it_says(page: str, tmp_path: Path):
    codes = json.dumps([code for code, _ in SNIPPETS[page]])
    # The pages use the present names. The snippets are `__main__`, so others may warn.
    command = [sys.executable, "-W", "error::DeprecationWarning:__main__", "-c", _RUN]
    done = subprocess.run(
        command, cwd=tmp_path, input=codes, stdout=subprocess.PIPE, text=True, check=True
    )
    for (code, said), printed in zip(SNIPPETS[page], json.loads(done.stdout), strict=True):
        assert printed == said, code


def test_the_readme_is_short():
    assert len(README.split()) <= 900


def test_the_index_leads_to_every_page():
    pages = {path.name for path in (PROJECT / "docs").glob("*.md")} - {"index.md"}
    assert pages == {page for page in pages if f"]({page})" in INDEX}


def test_the_index_says_what_every_module_is_for():
    import torch

    import pacnet

    names = [name for name in pacnet.__all__ if isinstance(getattr(pacnet, name), type)]
    modules = [name for name in names if issubclass(getattr(pacnet, name), torch.nn.Module)]
    assert len(modules) > 8
    assert [name for name in modules if f"`{name}" not in INDEX] == []


@pytest.mark.slow
@pytest.mark.parametrize("module", MODULES)
def test_its_commands_explain_themselves(module: str):
    command = [sys.executable, "-m", module, "--help"]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=True)
    assert "usage:" in done.stdout
    assert "--help" in done.stdout


def commands(name: str) -> list[list[str]]:
    """The arguments of each command of that name in the block about LeRobot datasets."""
    block = README.split("## With a LeRobot dataset")[1].split("```")[1]
    lines = [shlex.split(line, comments=True) for line in block.splitlines()]
    return [words[1:] for words in lines if words[:1] == [name]]


def test_its_commands_have_these_arguments():
    parser = make_parser()
    parsed = [parser.parse_args(arguments) for arguments in commands("pacnet")]
    assert [arguments.run.__module__ for arguments in parsed] == [
        "pacnet.cli.fit", "pacnet.cli.watch", "pacnet.cli.explain"
    ]  # fmt: skip


@pytest.mark.slow
def test_its_training_has_these_arguments():
    pytest.importorskip("lerobot")
    (arguments,) = commands("lerobot-train")
    code = f"""
import draccus
import lerobot_policy_pacnet
from lerobot.configs.train import TrainPipelineConfig
config = draccus.parse(TrainPipelineConfig, args={arguments})
assert config.policy.type == "pacnet"
"""
    subprocess.run([sys.executable, "-c", code], cwd=PROJECT, check=True)


def anchors(text: str) -> set[str]:
    """What a link to a heading of the page may say after its `#`."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```", "", text, flags=re.S | re.M), re.M)
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", TEXTS)
def test_links_and_images_lead_somewhere(page: str):
    folder = (PROJECT / page).parent
    for link in re.findall(r"\]\(([^)]+)\)", TEXTS[page]):
        if link.startswith("https://"):
            continue
        path, _, anchor = link.partition("#")
        target = folder / path if path else PROJECT / page
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target.read_text()), link


def test_the_citation_is_of_this_version():
    declared = re.search(r'^version = "(.*)"$', (PROJECT / "pyproject.toml").read_text(), re.M)
    cited = re.search(r"^version: (.*)$", (PROJECT / "CITATION.cff").read_text(), re.M)
    assert declared
    assert cited
    assert cited[1] == declared[1]


STREAMS = ("plain", "rests of a minute", "one toast in 21", "noise × 3")
FORTY = tuple(f"{stream} | 40" for stream in STREAMS)
MEMORY = (
    ("alone", f"| kept | {' | '.join(STREAMS)} |", FORTY),
    ("cues", "| kept | plain, 40 |", (*FORTY, "rests of a minute | 200")),
    (
        "walls",
        "| kept | 1-NN: wf |",
        [f"{STREAMS[1]} | {k}-NN {score}" for k in (1, 8) for score in ("wf", "tight")],
    ),
)


def shipped(path: str) -> dict:
    return json.loads((PROJECT / "checkpoints" / path).read_text())


def cells(row: str) -> list[str]:
    return [cell.strip(" *") for cell in row.strip("|").split("|")]


def test_the_comparison_holds_the_numbers_of_the_pages():
    table = README.split("| instead of pacnet | measured | theirs | pacnet |")[1].split("\n\n")[0]
    rows = [cells(row) for row in table.splitlines()[2:]]
    measured = {number for row in PERFORMANCE.splitlines() for number in cells(row)}
    for row in rows[:5]:
        assert set(row[2:]) <= measured, row
    successes = {row[0]: row for row in map(cells, BENCHMARKS.splitlines()) if len(row) == 7}
    nearest, cloning, ours = 3, 6, 2  # columns
    assert rows[5][2:] == [successes["all, 1"][column] for column in (nearest, ours)]
    assert rows[6][2:] == [successes["all, 20"][column] for column in (cloning, ours)]
    errors = [cells(row) for row in BENCHMARKS.splitlines() if row.startswith(ROBOTS)][:3]
    means = [sum(float(row[column]) for row in errors) / 3 for column in (10, 6)]
    assert rows[7][2:] == [f"{mean:.2f}" for mean in means]
    budget = BENCHMARKS.split("## Real datasets: under a budget")[1]
    errors = [cells(row) for row in budget.splitlines() if row.startswith(ROBOTS)][:3]
    means = [sum(float(row[column]) for row in errors) / 3 for column in (5, 4)]
    assert rows[8][2:] == [f"{mean:.2f}" for mean in means]
    areas = [
        cells(row)[1]
        for learner in ("blended replay", "`Imitator`")
        for row in BENCHMARKS.splitlines()
        if row.startswith(f"| undisturbed, 3, {learner}")
    ]
    assert rows[9][2:] == areas

    policies = shipped("behaviours/retraining.json")["policies"]
    successes = [scores["task_success_rate"]["mean"] for scores in policies.values()]
    assert rows[10][2:] == [f"{success:.2f}" for success in successes[2:4]]
    conditions = shipped("wall_following/metrics.json")["conditions"]
    drinks = shipped("postural_imitation/alone.json")["alone"]["success"]
    others = ("replay of the nearest", "ours")
    assert rows[11][2:] == [f"{drinks[f'alone, 15 cm | {one}']['mean']:.0%}" for one in others]
    seen = BENCHMARKS.split("## Metaworld, seen by a camera")[1].splitlines()
    starts = ("| task, demonstrations", "| pick-place, 20")
    header, picking = [cells(row) for row in seen if row.startswith(starts)][:2]
    assert rows[12][2:] == [picking[header.index(learner)] for learner in ("BC", "`Imitator`")]
    tights = [conditions[name]["tight"]["mean"] for name in ("teacher's controller", "recall")]
    assert [row[2:] for row in rows[13:]] == [[f"{tight:.2f}" for tight in tights]]


def test_its_table_holds_the_shipped_scores():
    scores = json.loads((PROJECT / "checkpoints/postural_imitation/metrics.json").read_text())
    shown = {
        "task_success_rate": f"{scores['task_success_rate']:.2f}",
        "wrist_distance_mean_m": f"{100 * scores['wrist_distance_mean_m']:.1f} cm",
        "wrist_distance_max_m": f"{100 * scores['wrist_distance_max_m']:.1f} cm",
        "area_between_curves_m2": f"{1e4 * scores['area_between_curves_m2']:.0f} cm²",
        "joint_rms_deg": f"{scores['joint_rms_deg']:.1f}°",
        "nodes": str(scores["nodes"]),
        "pca_variance_2": f"{100 * scores['pca_variance_2']:.0f} %",
        "winner_order_agreement": f"{scores['winner_order_agreement']:.2f}",
        "switches_per_episode": f"{scores['switches_per_episode']:.1f}",
    }
    table = EXPERIMENTS.split("| 100 recall episodes |")[1].split("\n\n")[0]
    measured = [row.rsplit("|", 2)[1].strip() for row in table.splitlines()[2:]]
    assert measured == list(shown.values())


def test_the_table_of_babbling_holds_the_shipped_scores():
    ways = shipped("body/metrics.json")["ways"]
    table = EXPERIMENTS.split("| learned from 5,000 postures |")[1].split("\n\n")[0]
    expected = [
        [
            f"{way['place_rms_mm']:.1f} mm",
            f"{way['turn_rms_deg']:.2f}°",
            f"{way['fit_s']:.1f} s",
        ]
        for way in ways.values()
    ]
    assert [cells(row)[1:] for row in table.splitlines()[2:]] == expected


def test_its_table_of_conditions_holds_the_shipped_scores():
    shipped = PROJECT / "checkpoints/postural_imitation/robustness.json"
    conditions = json.loads(shipped.read_text())["conditions"]
    table = EXPERIMENTS.split("| | success | wrist distance, mean | largest | commanded |")[1]
    rows = [row.strip("| ").split(" | ") for row in table.split("\n\n")[0].splitlines()[2:]]
    assert rows == [
        [
            name.replace(" x ", " × "),
            f"{scores['task_success_rate']:.2f}",
            f"{100 * scores['wrist_distance_mean_m']:.1f} cm",
            f"{100 * scores['wrist_distance_max_m']:.1f} cm",
            f"{100 * scores['commanded_share']:.1f} %",
        ]
        for name, scores in conditions.items()
    ]


def test_the_table_of_wall_following_holds_the_shipped_scores():
    shipped = PROJECT / "checkpoints/wall_following/metrics.json"
    conditions = json.loads(shipped.read_text())["conditions"]
    table = EXPERIMENTS.split("| condition | wf | tight | energy | contacts |")[1].split("\n\n")[0]
    rows = [row.strip("| ").split(" | ") for row in table.splitlines()[2:]]
    assert rows == [
        [
            name,
            *(f"{scores[key]['mean']:.2f} ± {scores[key]['std']:.2f}" for key in KEYS),
            f"{100 * scores['contact_share']['mean']:.1f} %",
        ]
        for name, scores in conditions.items()
    ]


def test_the_tables_of_memory_hold_the_shipped_scores():
    text = TEXTS["docs/memory.md"]
    for name, head, columns in MEMORY:
        folder = "wall_following" if name == "walls" else "postural_imitation"
        scores = shipped(f"{folder}/memory_{name}.json")[name]
        table = text.split(head)[1].split("\n\n")[0]
        for row, *measured in map(cells, table.splitlines()[2:]):
            wanted = [scores[f"{column} | {row}"] for column in columns]
            assert measured == [f"{one['mean']:.2f} ± {one['std']:.2f}" for one in wanted], row


def test_the_table_of_recognition_holds_the_shipped_scores():
    scores = shipped("behaviours/metrics.json")
    seen, new = scores["recognition"], scores["novelty"]
    completed = scores["recall"]["several schemas per node"]
    shown = [completed[name]["task_success_rate"] for name in ("drink", "toast")]
    table = BEHAVIOURS.split("| wanted | measured |")[1].split("\n\n")[0]
    assert [row.rsplit("|", 2)[1].strip() for row in table.splitlines()[2:]] == [
        " / ".join(f"{share:.2f}" for share in shown),
        f"{seen['named_within_a_tenth_share']:.2f}",
        f"{seen['named_after_a_tenth_samples_share']:.3f}",
        f"{seen['progress_error_mean']:.3f}",
        f"{seen['end_wrist_error_mean_m']:.3f} m",
        f"{seen['next_percept_error_to_persistence']:.2f}",
        f"{new['auroc_per_episode']:.3f}",
        f"{new['auroc_per_frame_after_approach']:.3f}",
        f"{100 * new['false_alarm_share']:.2f} %",
        f"{100 * new['alarm_share_new_after_approach']:.1f} %",
    ]


def test_the_table_of_retraining_holds_the_shipped_scores():
    policies = shipped("behaviours/retraining.json")["policies"]
    table = BEHAVIOURS.split("| task success | wrist, mean |")[1].split("\n\n")[0]
    rows = [[cell.strip() for cell in row.split("|")[2:4]] for row in table.splitlines()[2:]]
    assert rows == [
        [
            "{mean:.2f} ± {std:.2f}".format(**scores["task_success_rate"]),
            f"{100 * scores['wrist_distance_mean_m']['mean']:.1f} ± "
            f"{100 * scores['wrist_distance_mean_m']['std']:.1f} cm",
        ]
        for scores in policies.values()
    ]


def test_the_table_of_the_schema_network_holds_the_shipped_scores():
    systems = shipped("schema_network/metrics.json")["systems"]
    title = "| divided by hand | divided by attention | PACNet |"
    table = list(map(cells, BEHAVIOURS.split(title)[1].split("\n\n")[0].splitlines()[2:]))
    names = ("schema network", "schema network by attention", "PACNet")
    rows = {"switches": 1, "strictly_in_order_rate": 2, "own_share": 2, "task_success_rate": 2}
    for (_, *shown), (score, digits) in zip(table, rows.items(), strict=False):
        assert shown == [score_text(systems[name], score, digits) for name in names], score


def score_text(system: dict, score: str, digits: int) -> str:
    """Return a score of each behaviour as the table has it."""
    behaviours = [system[name] for name in ("drink", "toast", "move")]
    if score not in behaviours[0]:
        return "–"
    return " / ".join(f"{scores[score]:.{digits}f}" for scores in behaviours)


def mean_text(summary: dict | None, factor: float, digits: int) -> str:
    """Return a mean as tables have it, with the standard deviation over several replicates."""
    if summary is None:
        return "–"
    spread = f" ± {factor * summary['std']:.{digits}f}" if len(summary["values"]) > 1 else ""
    return f"{factor * summary['mean']:.{digits}f}{spread}"


def test_the_tables_of_who_acts_alone_hold_the_shipped_scores():
    scores = shipped("postural_imitation/alone.json")["alone"]
    for name, factor, digits in (("success", 1, 2), ("distance_m", 100, 1)):
        title = {"success": "success", "distance_m": "wrist path [cm]"}[name]
        table = EXPERIMENTS.split(f"| {title} |")[1].split("\n\n")[0].splitlines()
        scenes = [cell.strip() for cell in table[0].strip("|").split("|")]
        for row, *shown in map(cells, table[2:]):
            summaries = [scores[name].get(f"{scene} | {row}") for scene in scenes]
            expected = [mean_text(summary, factor, digits) for summary in summaries]
            assert shown == expected, row
