"""The prepared arrangement of panels, for a viewer to import."""

import json

import foxglove.layouts as fl

from wackel_view.core import HEALTH, LOG, ODOMETRY, PATH, ROBOT, VELOCITY
from wackel_view.robot_scene import ROBOT as ROBOT_FRAME
from wackel_view.robot_scene import WORLD
from wackel_view.velocity_scene import FRAME

_COLOURS = {"ok": "#40b35a", "warning": "#f2a61a", "unknown": "#8c8c8c", "fault": "#e62626"}


def layout() -> str:
    """As JSON."""
    made = fl.Layout(
        content=_split(
            "row",
            (2, _split("column", (3, _driving()), (2, _velocity_space()))),
            (1, _split("column", (1, _level()), (3, _health()), (3, _log()), (2, _twist()))),
        )
    )
    return json.dumps(json.loads(made.to_json()), indent=1)


def _split(direction: str, *items: tuple[float, fl.Content]) -> fl.SplitContainer:
    return fl.SplitContainer(
        direction="row" if direction == "row" else "column",
        items=[fl.SplitItem(proportion=share, content=content) for share, content in items],
    )


def _driving() -> fl.Content:
    return fl.ThreeDeePanel(
        title="Robot",
        config=fl.ThreeDeeConfig(
            follow_tf=ROBOT_FRAME,
            fixed_frame=WORLD,
            follow_mode="follow-position",
            camera_state=fl.ThreeDeeCameraState(distance=4.0, phi=45.0, perspective=True),
            layers={
                "grid": fl.BaseRendererGridLayerSettings(frame_id=WORLD, size=20, divisions=20)
            },
            topics={
                ROBOT: fl.BaseRendererSceneUpdateTopicSettings(visible=True),
                PATH: fl.BaseRendererPosesTopicSettings(visible=True, type="line"),
                VELOCITY: fl.BaseRendererSceneUpdateTopicSettings(visible=False),
            },
        ),
    )


def _velocity_space() -> fl.Content:
    return fl.ThreeDeePanel(
        title="Velocity space: candidates of the wheels",
        config=fl.ThreeDeeConfig(
            follow_tf=FRAME,
            fixed_frame=FRAME,
            camera_state=fl.ThreeDeeCameraState(distance=2.0, phi=60.0, perspective=True),
            topics={
                VELOCITY: fl.BaseRendererSceneUpdateTopicSettings(visible=True),
                ROBOT: fl.BaseRendererSceneUpdateTopicSettings(visible=False),
                PATH: fl.BaseRendererPosesTopicSettings(visible=False),
            },
        ),
    )


def _level() -> fl.Content:
    return fl.IndicatorPanel(
        title="Health",
        config=fl.IndicatorConfig(
            path=f"{HEALTH}.level",
            style="background",
            rules=[
                fl.IndicatorRule(operator="=", raw_value=level, color=colour, label=level)
                for level, colour in _COLOURS.items()
            ],
            fallback_color=_COLOURS["unknown"],
            fallback_label="unknown",
        ),
    )


def _health() -> fl.Content:
    return fl.RawMessagesPanel(
        title="Health, in words",
        config=fl.RawMessagesConfig(topic_path=f"{HEALTH}.text", default_expanded=True),
    )


def _log() -> fl.Content:
    return fl.LogPanel(title="Faults", config=fl.LogConfig(topic_to_render=LOG, min_log_level=1))


def _twist() -> fl.Content:
    return fl.PlotPanel(
        title="Velocity",
        config=fl.PlotConfig(
            paths=[
                fl.PlotSeries(value=f"{ODOMETRY}.{name}", label=name)
                for name in ("vx", "vy", "omega")
            ],
        ),
    )
