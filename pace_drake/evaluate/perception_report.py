"""What the cameras' accuracy is written as: tables, JSON, CSV, pictures."""

import csv
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from pace_drake.evaluate.perception import PICTURES, Evaluation, Measurement, View, working_height
from pace_drake.evaluate.report import Table
from pace_drake.files import write_whole
from pace_drake.perception import PinholeCamera
from pace_drake.perception.opencv import import_opencv
from pace_drake.stations.camera import pinhole_camera

_AXIS = 0.05  # [m] length of a drawn axis


def summarize(measurements: Sequence[Measurement]) -> dict[str, float | int | None]:
    """Number, share seen, and median, 95 % and maximum of the errors of position [mm] and yaw [deg]."""
    position = [1e3 * m.position_error for m in measurements if m.position_error is not None]
    yaw = [float(np.degrees(m.yaw_error)) for m in measurements if m.yaw_error is not None]
    summary: dict[str, float | int | None] = {"looks": len(measurements), "seen": len(position) / len(measurements)}
    for name, errors in (("position_mm", position), ("yaw_deg", yaw)):
        for what, share in (("median", 50), ("p95", 95), ("max", 100)):
            summary[f"{name}_{what}"] = float(np.percentile(errors, share)) if errors else None
    return summary


def to_json(evaluation: Evaluation) -> dict:
    """All figures: at the workcell's own heights by component, at all heights by camera; hidden; costs."""
    measurements = evaluation.measurements
    at_work = [m for m in measurements if m.height == working_height(evaluation.workcell, m.camera)]
    components = dict.fromkeys(m.component for m in measurements)
    places = sorted({(m.camera, m.height) for m in measurements})
    return {
        "working": [
            {
                "component": name,
                "camera": next(m.camera for m in at_work if m.component == name),
                "pictures": pictures,
                **summarize([m for m in at_work if (m.component, m.pictures) == (name, pictures)]),
            }
            for pictures in PICTURES
            for name in components
        ],
        "heights": [
            {
                "camera": camera,
                "height": height,
                "pictures": pictures,
                **summarize(
                    [m for m in measurements if (m.camera, m.height, m.pictures) == (camera, height, pictures)]
                ),
            }
            for pictures in PICTURES
            for camera, height in places
        ],
        "hidden": [
            {
                "covered": covered,
                "tags": tags,
                "looks": len(errors),
                "seen": sum(error is not None for error in errors),
                "position_mm_max": max((1e3 * error for error in errors if error is not None), default=None),
            }
            for (covered, tags), errors in _hidden(evaluation).items()
        ],
        "render_ms": 1e3 * float(np.median(evaluation.render_times)) if evaluation.render_times else None,
        "detect_ms": 1e3 * float(np.median(evaluation.detect_times)) if evaluation.detect_times else None,
    }


def tables(evaluation: Evaluation) -> list[Table]:
    """For people."""
    figures = to_json(evaluation)
    columns = ["looks", "seen", "median [mm]", "95 %", "max", "yaw median [deg]", "95 %", "max"]

    def cells(row: dict) -> list[str]:
        errors = [row[f"{name}_{what}"] for name in ("position_mm", "yaw_deg") for what in ("median", "p95", "max")]
        return [
            str(row["looks"]),
            f"{row['seen']:.1%}",
            *("-" if error is None else f"{error:.2f}" for error in errors),
        ]

    return [
        Table(
            "At the cameras' own heights",
            ["component", "camera", "pictures", *columns],
            [[row["component"], row["camera"], row["pictures"], *cells(row)] for row in figures["working"]],
        ),
        Table(
            "At other heights over the table [m]",
            ["camera", "height", "pictures", *columns],
            [[row["camera"], f"{row['height']:.2f}", row["pictures"], *cells(row)] for row in figures["heights"]],
        ),
        Table(
            "Under a plate",
            ["covered", "tags", "looks", "seen", "max error [mm]"],
            [
                [
                    row["covered"],
                    row["tags"],
                    str(row["looks"]),
                    str(row["seen"]),
                    "-" if row["position_mm_max"] is None else f"{row['position_mm_max']:.2f}",
                ]
                for row in figures["hidden"]
            ],
        ),
    ]


def write_report(out: Path, evaluation: Evaluation) -> None:
    """Writes errors.csv, and a picture a camera with what was found drawn into it.

    Args:
        out: folder that is there.
        evaluation: what was measured.
    """
    write_whole(out / "errors.csv", lambda part: _write_csv(part, evaluation.measurements))
    cv2 = import_opencv()
    for view in evaluation.views:
        pinhole = pinhole_camera(evaluation.workcell.cameras[view.camera])
        _, png = cv2.imencode(".png", annotate(view, pinhole))
        write_whole(out / f"{view.camera}.png", partial(Path.write_bytes, data=png.tobytes()))


def annotate(view: View, camera: PinholeCamera) -> np.ndarray:
    """The picture (blue green red) with corners and ids of tags, and the axes of the components found by them."""
    cv2 = import_opencv()
    picture = cv2.cvtColor(np.ascontiguousarray(view.color[:, :, :3]), cv2.COLOR_RGB2BGR)
    sub = {"lineType": cv2.LINE_AA, "shift": 4}  # coordinates in 16ths of a pixel

    def at(pixel: np.ndarray) -> tuple[int, int]:
        return int(np.rint(16 * pixel[0])), int(np.rint(16 * pixel[1]))

    for _, corners in view.tags:
        cv2.polylines(picture, [np.round(16 * corners).astype(np.int32)], True, (255, 0, 255), 1, **sub)
        for corner in corners:
            cv2.circle(picture, at(corner), 16 * 3, (0, 255, 255), 1, **sub)
    for name, pose in view.found.items():
        ends = camera.project(pose.to_world(np.vstack([np.zeros(3), _AXIS * np.eye(3)])))
        for end, color in zip(ends[1:], ((0, 0, 255), (0, 200, 0), (255, 0, 0)), strict=True):
            cv2.line(picture, at(ends[0]), at(end), color, 2, **sub)
        text = f"{name} {np.degrees(pose.yaw):.1f} deg"
        (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)
        u, v = int(ends[0][0]) - width // 2, int(ends[0][1]) + 50
        cv2.rectangle(picture, (u - 3, v - height - 3), (u + width + 3, v + below), (255, 255, 255), cv2.FILLED)
        cv2.putText(picture, text, (u, v), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (20, 20, 20), 1, cv2.LINE_AA)
    return picture


def _hidden(evaluation: Evaluation) -> dict[tuple[str, str], list[float | None]]:
    groups: dict[tuple[str, str], list[float | None]] = {}
    for hidden in sorted(evaluation.hidden, key=lambda h: (h.covered != "whole", h.component == "chair_side")):
        tags = "four" if hidden.component == "chair_side" else "one"
        groups.setdefault((hidden.covered, tags), []).append(hidden.position_error)
    return groups


def _write_csv(path: Path, measurements: Sequence[Measurement]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["placement", "component", "camera", "height", "pictures", "position_error", "yaw_error"])
        for m in measurements:
            writer.writerow([m.number, m.component, m.camera, m.height, m.pictures, m.position_error, m.yaw_error])
