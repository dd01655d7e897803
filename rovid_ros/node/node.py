"""The live node: subscriptions in, the pipe, publishers out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rovid_core.identify.estimate import Estimate
from rovid_core.model.samples import Event
from rovid_core.pipeline.steps import Scorer
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings
from rovid_ros.commands.controls import apply, changes_of, PARAMETERS, repeat
from rovid_ros.config.input_topics import inputs_of
from rovid_ros.messages.convert import Converter
from rovid_ros.node.checkpoint import Checkpoint
from rovid_ros.node.health.console import Report
from rovid_ros.node.parameters import NODE_NAME, ParameterNode
from rovid_ros.node.recorder import Received, Recorder
from rovid_ros.node.services import Services
from rovid_ros.node.transport.intake import Intake
from rovid_ros.node.transport.message_classes import definition
from rovid_ros.node.transport.publishers import Publishers
from rovid_ros.node.transport.subscriptions import message_classes, Subscriptions
from rovid_ros.results.outputs import Outputs


class IdentifierNode(ParameterNode):
    """
    The identifier as a managed ROS 2 node.

    Configured it has its outputs and services, active its inputs. With ``autostart`` it is
    active once it is made.

    Parameters
    ----------
    values : mapping, optional
        Parameters by dotted key, as a parameter file gives them; ``-p`` overrides win.
    live : bool
        False: no subscriptions, no recording and no checkpoint; the owner feeds it. It
        always starts by itself.
    scorer : Scorer, optional
        Told every step.

    Attributes
    ----------
    stream, converter
        What the node runs, once it is configured.

    Raises
    ------
    ValueError
        If a parameter, a message type or a field path is wrong, or a file cannot be
        written; one line. Without ``autostart`` it is the transition that fails.

    """

    def __init__(self, values: Mapping[str, Any] | None = None, *, live: bool = True,
                 scorer: Scorer | None = None) -> None:
        self._configured = False
        self._live = live
        self._scorer = scorer
        self._period: Timer | None = None
        super().__init__(NODE_NAME, values or {}, autostart=not live)

    @property
    def settings(self) -> Settings:
        """Return what the node runs with; live parameters change it."""
        return self.stream.settings

    @property
    def heard(self) -> list[Subscription[Any]]:
        """Return the subscriptions of the inputs, none while it is not active."""
        return self._in.subscriptions if self.active and self._live else []

    def configure(self) -> None:
        """Make all but the inputs."""
        settings = self.initial()
        if not self._live:
            settings = replace(settings, record_path='', checkpoint_path='')
        self._prepare(settings)
        if self.changes:
            apply(self.stream, self.changes)
        self.note({'enable': self.stream.adapting})
        self._open()

    def activate(self) -> None:
        """Subscribe."""
        self._in = Subscriptions(
            self, self.settings, self._classes, self.converter.topics, self._take,
            self.stream.reject)
        self._report.activated()
        self._introduce()

    def deactivate(self) -> None:
        """Publish what is held and hear nothing more; the estimate stays."""
        self._in.drain()
        self._tell(self.stream.interrupt())
        self._out.catch_up(self._outputs)
        self._in.close()
        if self.settings.checkpoint_path:
            self._checkpoint.save()
        if self._recorder:
            self._recorder.flush()

    def _prepare(self, settings: Settings) -> None:
        """Make everything that can be refused; nothing is visible outside yet."""
        self._recorder = Recorder(
            Path(settings.record_path), definition,
            self.get_logger().error) if settings.record_path else None
        self.stream = Stream(settings, recorder=self._recorder, scorer=self._scorer)
        self.converter = Converter(settings, self.stream.reject)
        self._classes = message_classes(settings, self.converter) if self._live else {}
        self._report = Report(self, self.stream, self._recorder, live=self._live)
        self._intake = Intake(self.stream, self.converter, self._classes, self._report.arrivals,
                              self.get_logger(), keep=self._recorder is not None)
        self._outputs = Outputs(settings)
        self._checkpoint = Checkpoint(settings, self.stream, self.get_logger())
        restored = self._checkpoint.restore()
        if self._recorder:
            self._recorder.open(restored)
            self.made.callback(self._recorder.close)
            self.get_logger().info(f'recording to {self._recorder.path}')

    def _open(self) -> None:
        """Appear in the graph."""
        self._out = Publishers(self)
        self.made.callback(self._out.close)
        self._add_timer(1.0, self._each_second)
        self._save_again_and_again()
        self.made.callback(Services(self, self, self.settings.checkpoint_path).close)
        self._configured = True
        self.made.callback(setattr, self, '_configured', False)

    def _add_timer(self, period: float, act: Callable[[], None]) -> Timer:
        timer = self.create_timer(period, act, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.made.callback(self.destroy_timer, timer)
        return timer

    def _save_again_and_again(self) -> None:
        if self._period is not None:
            self.destroy_timer(self._period)
        self._period = self._add_timer(
            self.settings.checkpoint_period, self._each_period) if (
                self.settings.checkpoint_path) else None

    def feed(self, topic: str, message: Any, receive_time: int) -> list[Estimate]:
        """
        Take a message and publish the estimates that it releases.

        Parameters
        ----------
        topic : str
            As configured.
        message : object
            Of rclpy or of rosbags.
        receive_time : int
            When it came [ns].

        Returns
        -------
        estimates : list of Estimate
            What was published; none while it is not active.

        """
        if not self.active:
            return []
        return self._publish(self._intake.events(topic, message, receive_time))

    def control(self, name: str, value: str) -> list[Estimate]:
        """Do again what was done to a node when a log was recorded; publish and return."""
        if not self.active:
            return []
        estimates = self._tell(repeat(self.stream, name, value))
        if name == 'reset':
            self._show_initial()
        if name == PARAMETERS:
            self.note(changes_of(value))
        self.note({'enable': self.stream.adapting})
        return estimates

    def take(self) -> None:
        """Take what waits on the inputs, and publish the estimates that it releases."""
        self._in.take()

    def finish(self) -> list[Estimate]:
        """Publish what is held, save the state and end the record; for the end of a run."""
        if not self._configured:
            return []
        if self.active:
            self._in.drain()
        estimates = self._tell(self.stream.finish())
        self._out.catch_up(self._outputs)
        if self.settings.checkpoint_path:
            self._checkpoint.save()
        if self._recorder:
            self._recorder.close()
        self._report.finish()
        self._out.wait(1.0)
        return estimates

    def reset(self) -> None:
        """Go back to the initial values."""
        self.stream.reset()
        self._show_initial()

    def enable(self, adapt: bool) -> None:
        """Adapt the parameters, or freeze them."""
        self.stream.enable(adapt)
        self.note({'enable': adapt})

    def save(self) -> str:
        """Save the state; return why not, or ''."""
        return self._checkpoint.save()

    def present(self) -> Settings:
        """Return the settings that a change is judged with."""
        return self.settings if self._configured else super().present()

    def change(self, changes: Mapping[str, Any]) -> None:
        """Go on with other values of live parameters."""
        if self._configured:
            apply(self.stream, changes)
            self._tell([])
        if self._configured and 'checkpoint.period' in changes:
            self._save_again_and_again()

    def _take(self, batch: dict[str, list[Received]]) -> None:
        self._publish(self._intake.merged(batch))

    def _publish(self, events: Iterable[Event]) -> list[Estimate]:
        return [estimate for event in events for estimate in self._tell(
            self.stream.receive(event))]

    def _tell(self, estimates: list[Estimate]) -> list[Estimate]:
        self._out.tell(self._outputs, estimates)
        self._report.told(estimates)
        return estimates

    def _show_initial(self) -> None:
        """Let the latched parameters be those that a reset went back to."""
        for output in self._outputs.reset():
            self._out.publish(output)

    def _each_second(self) -> None:
        self._out.catch_up(self._outputs)
        self._out.publish(self._report.each_second(self.label))
        if self._recorder:
            self._recorder.flush()

    def _each_period(self) -> None:
        self._checkpoint.save()

    def _introduce(self) -> None:
        log = self.get_logger()
        for topic, type_name in self.converter.topics.items():
            names = ' and '.join(inputs_of(self.settings, topic))
            log.info(f'{names}: {self.resolve_topic_name(topic)} ({type_name})')
        for dof in self.settings.dofs:
            log.info(f'{dof}: velocity from {self.settings.source(dof)}')
        self._tell([])  # the warnings so far
