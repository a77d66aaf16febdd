"""What the README shows is true: its Python runs, its commands exist, its pictures are there."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from pacnet.cli import make_parser

PROJECT = Path(__file__).parents[2]
README = (PROJECT / "README.md").read_text()
EXPERIMENTS = (PROJECT / "docs/experiments.md").read_text()
BEHAVIOURS = (PROJECT / "docs/behaviours.md").read_text()
LEROBOT = (PROJECT / "docs/lerobot.md").read_text()
KEYS = ("wf", "tight", "energy")
PAGES = README + EXPERIMENTS + BEHAVIOURS + LEROBOT
MODULES = sorted(set(re.findall(r"python -m ((?:train|benchmarks)\.\w+)", PAGES)))


def test_its_python_runs_as_it_stands(tmp_path: Path):
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
    assert (tmp_path / "my_net" / "model.safetensors").is_file()


@pytest.mark.parametrize("text", [EXPERIMENTS, BEHAVIOURS], ids=["experiments", "behaviours"])
def test_the_python_of_a_page_runs_as_it_stands(text: str):
    (code,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    subprocess.run([sys.executable, "-c", code], cwd=PROJECT, check=True)


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


def test_its_links_lead_somewhere():
    docs = PROJECT / "docs"
    pages = (
        (PROJECT, README, 5),
        (docs, EXPERIMENTS, 5),
        (docs, BEHAVIOURS, 5),
        (docs, LEROBOT, 0),
    )
    for folder, text, more_than in pages:
        links = re.findall(r"\]\(([^)#:]+)\)", text)
        assert len(links) > more_than
        for link in links:
            assert (folder / link).exists(), link


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
    table = README.split("| 100 recall episodes |")[1].split("\n\n")[0]
    measured = [row.rsplit("|", 2)[1].strip() for row in table.splitlines()[2:]]
    assert measured == list(shown.values())


def test_its_table_of_conditions_holds_the_shipped_scores():
    shipped = PROJECT / "checkpoints/postural_imitation/robustness.json"
    conditions = json.loads(shipped.read_text())["conditions"]
    table = README.split("| | success | wrist distance, mean | largest | commanded |")[1]
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


@pytest.mark.parametrize("text", [README, EXPERIMENTS], ids=["README", "experiments"])
def test_the_table_of_wall_following_holds_the_shipped_scores(text: str):
    shipped = PROJECT / "checkpoints/wall_following/metrics.json"
    conditions = json.loads(shipped.read_text())["conditions"]
    table = text.split("| condition | wf | tight | energy | contacts |")[1].split("\n\n")[0]
    rows = [row.strip("| ").split(" | ") for row in table.splitlines()[2:]]
    assert rows == [
        [
            name,
            *(f"{scores[key]['mean']:.2f} ± {scores[key]['std']:.2f}" for key in KEYS),
            f"{100 * scores['contact_share']['mean']:.1f} %",
        ]
        for name, scores in conditions.items()
    ]


def shipped(path: str) -> dict:
    return json.loads((PROJECT / "checkpoints" / path).read_text())


@pytest.mark.parametrize("text", [README, BEHAVIOURS], ids=["README", "behaviours"])
def test_the_table_of_recognition_holds_the_shipped_scores(text: str):
    scores = shipped("behaviours/metrics.json")
    seen, new = scores["recognition"], scores["novelty"]
    completed = scores["recall"]["several schemas per node"]
    shown = [completed[name]["task_success_rate"] for name in ("drink", "toast")]
    table = text.split("| wanted | measured |")[1].split("\n\n")[0]
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
    table = BEHAVIOURS.split("| schema network | PACNet |")[1].split("\n\n")[0]
    switches = [cell.strip() for cell in table.splitlines()[2].split("|")[2:4]]
    assert switches == [
        " / ".join(f"{systems[name][kind]['switches']:.1f}" for kind in ("drink", "toast", "move"))
        for name in ("schema network", "PACNet")
    ]
