"""Text and plot of Tables III and IV: our metrics, the paper's, and the larger differences."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

from common.files import atomic_path
from common.markdown import markdown
from evaluation.config import GROUND_TRUTH, NETWORK
from experiments.paper import TABLE5_COLUMNS
from experiments.runs import mean_and_spread, shown
from experiments.table5 import our_cells
from training.config import ScheduleConfig

BOXES = {NETWORK: "the detector's boxes", GROUND_TRUTH: "true boxes"}
Figures = Mapping[str, Sequence[Sequence[Mapping[str, Any]]]]
"""Row -> seed -> metrics at each kind of boxes and displacement."""
Paper = Mapping[str, Sequence[float]]


def settings_of(figures: Figures) -> list[tuple[str, float]]:
    """(boxes, displacement) in the order of the table."""
    first = next(iter(figures.values()))[0]
    return sorted(((m["boxes"], m["displacement"]) for m in first), key=lambda s: s[0] != NETWORK)


def metrics_at(runs: Sequence[Sequence[Mapping[str, Any]]], setting: tuple[str, float]) -> list:
    """The entry of every seed at a setting."""
    return [m for run in runs for m in run if (m["boxes"], m["displacement"]) == setting]


def text_of(figures: Figures, paper: Paper, schedule: ScheduleConfig) -> str:
    """A part for each setting, the differences in words, and the end-point errors."""
    seeds = len(next(iter(figures.values())))
    text = (
        f"Mean ± standard deviation over {seeds} trainings of {schedule.epochs} x "
        f"{schedule.frames_per_epoch or 'all'} pairs, Algorithm 1 as published, `clear3d`, IoU "
        "0.5. The paper gives neither boxes nor displacement; its rows are of KITTI's validation "
        "sequences and stand beside the detector's boxes at 0 m.\n"
    )
    settings = settings_of(figures)
    for boxes, distance in settings:
        lines = []
        for name, runs in figures.items():
            found = metrics_at(runs, (boxes, distance))
            lines.append([name, *our_cells([m["clear3d"] for m in found])])
            if name in paper and (boxes, distance) == settings[0]:
                lines.append([f"paper: {name}", *(f"{v:.3f}" for v in paper[name]), "-", "-"])
        title = f"{BOXES[boxes].capitalize()}, D = {distance:g} m"
        text += f"\n## {title}\n\n" + markdown(["", *TABLE5_COLUMNS], lines)
        text += "\n" + differences(figures, (boxes, distance)) + "\n"
    text += "\n## End-point error of the displacement on foreground points, metres\n\n"
    distances = [distance for boxes, distance in settings if boxes == NETWORK]
    lines = [
        [
            name,
            *(
                shown([m["end_point_error"] for m in metrics_at(runs, (NETWORK, d))], 3)
                for d in distances
            ),
        ]
        for name, runs in figures.items()
    ]
    text += markdown(["", *(f"D = {d:g} m" for d in distances)], lines)
    return text + "\n" + order_sentence(figures, paper) + "\n"


def differences(figures: Figures, setting: tuple[str, float]) -> str:
    """Pairs of rows whose MOTA differs by more than the sum of both standard deviations.

    With three trainings of each, equal rows differ so in 8 % of the pairs (normal figures).
    """
    values = {
        name: mean_and_spread([m["clear3d"]["MOTA"] for m in metrics_at(runs, setting)])
        for name, runs in figures.items()
    }
    values = {name: value for name, value in values.items() if value[0] is not None}
    apart = []
    for (a, (mean_a, spread_a)), (b, (mean_b, spread_b)) in combinations(values.items(), 2):
        if abs(mean_a - mean_b) > spread_a + spread_b:
            apart.append(f"{a} > {b}" if mean_a > mean_b else f"{b} > {a}")
    total = len(values) * (len(values) - 1) // 2
    found = "; ".join(apart) if apart else "none"
    return f"Differences in MOTA above the sum of both spreads ({len(apart)} of {total}): {found}."


def order_sentence(figures: Figures, paper: Paper) -> str:
    """Compares the paper's order of MOTA with ours on the detector's boxes, by displacement."""
    best_first = sorted(paper, key=lambda name: -paper[name][0])
    parts = []
    for setting in (s for s in settings_of(figures) if s[0] == NETWORK):
        motas = {
            name: mean_and_spread([m["clear3d"]["MOTA"] for m in metrics_at(runs, setting)])[0]
            for name, runs in figures.items()
            if name in paper
        }
        ours = [] if None in motas.values() else sorted(motas, key=lambda name: -motas[name])
        verdict = "the same" if ours == best_first else " > ".join(ours) or "undefined"
        parts.append(f"at D = {setting[1]:g} m ours is {verdict}")
    return f"The paper's order of MOTA is {' > '.join(best_first)}; {', '.join(parts)}."


def draw(path: Path, title: str, figures: Figures, paper: Paper) -> None:
    """Plots MOTA of every row: a dot for each seed, mean with spread, the paper's as a cross."""
    from matplotlib.figure import Figure

    settings, names = settings_of(figures), list(figures)
    panels = list(dict.fromkeys(boxes for boxes, _ in settings))
    figure = Figure(figsize=(5 * len(panels), 1.2 + 0.45 * len(names)), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for boxes, axis in zip(panels, axes, strict=True):
        distances = [distance for where, distance in settings if where == boxes]
        for k, distance in enumerate(distances):
            color, offset = f"C{k}", 0.12 - 0.24 * k
            for row, name in enumerate(names):
                found = metrics_at(figures[name], (boxes, distance))
                motas = [m["clear3d"]["MOTA"] for m in found]
                mean, spread = mean_and_spread(motas)
                if mean is None:
                    continue
                height = len(names) - 1 - row + offset
                axis.plot(motas, [height] * len(motas), ".", color=color, alpha=0.5)
                label = f"D = {distance:g} m" if row == 0 else None
                axis.errorbar(
                    mean, height, xerr=spread, fmt="o", capsize=3, color=color, label=label
                )
        if boxes == NETWORK:
            heights = [len(names) - 1 - names.index(name) for name in paper]
            motas = [row[0] for row in paper.values()]
            axis.plot(motas, heights, "kx", label="the paper, KITTI's scans")
        axis.set(title=BOXES[boxes], xlabel="MOTA")
        axis.set_yticks(range(len(names)), reversed(names))
        axis.grid(alpha=0.3)
    figure.suptitle(title)
    handles, labels = axes[0].get_legend_handles_labels()  # the paper's cross is in the first alone
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=120, metadata={"Software": None})
