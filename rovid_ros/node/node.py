"""The live node: messages in, the stream, topics out, also in silence; services, transitions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
import time
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rovid_core.identify.estimate import Estimate
from rovid_core.model.samples import Event
from rovid_core.pipeline.steps import Scorer
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings
from rovid_ros import build
from rovid_ros.config.parameters import inputs_of
from rovid_ros.files.state_file import Checkpoint
from rovid_ros.logs.player import change_parameters, PARAMETERS, recorded_changes, repeat_control
from rovid_ros.logs.static_frames import TOPIC
from rovid_ros.messages.converter import Converter
from rovid_ros.node.health.console import HealthMonitor
from rovid_ros.node.parameters import ParameterNode
from rovid_ros.node.recorder import Received, Recorder
from rovid_ros.node.transport.inputs import (
    InputDecoder,
    is_simulated,
    look_up,
    message_class,
    Subscriptions,
)
from rovid_ros.node.transport.message_types import definition
from rovid_ros.node.transport.publishers import Publishers
from rovid_ros.results.outputs import Outputs
from std_srvs.srv import SetBool, Trigger

STALE_PERIOD = 0.25  # [s] A node that made no step for so long looks whether it has to say so
STALE_REPEAT = 1.0  # [s] from one message about it to the next, while nothing else changes


class IdentifierNode(ParameterNode):
    """
    The identifier as a managed ROS 2 node.

    ``configure`` makes its outputs and services, ``activate`` its inputs. With the parameter
    ``autostart`` it is active as soon as it is made.

    Parameters
    ----------
    values : mapping, optional
        Parameters by dotted key, as in a parameter file; ``-p`` overrides win.
    live : bool
        False: no subscriptions, no recording and no checkpoint; the owner calls
        ``add_message``. Such a node always starts by itself.
    scorer : Scorer, optional
        Gets every step.
    is_stopped : callable
        Tells whether the process is asked to end, which ends a look-up of frames.

    Attributes
    ----------
    stream, converter
        What the node runs, once it is configured.
    saved : bool
        Whether the last save at the end of a run went well, or there was nothing to save.

    Raises
    ------
    ValueError
        If a parameter, a message type or a field path is wrong, or a file cannot be
        written; one line. Without ``autostart`` it is the transition that fails.

    """

    def __init__(self, values: Mapping[str, Any] | None = None, *, live: bool = True,
                 scorer: Scorer | None = None,
                 is_stopped: Callable[[], bool] = lambda: False) -> None:
        self._live = live
        self._is_stopped = is_stopped
        self.saved = True
        self._scorer = scorer
        self._save_timer: Timer | None = None
        super().__init__(values or {}, autostart=not live)

    @property
    def settings(self) -> Settings:
        """Return the present settings; live parameters change them."""
        return self.stream.settings

    @property
    def input_subscriptions(self) -> list[Subscription[Any]]:
        """Return the subscriptions of the inputs, none while the node is not active."""
        return self._inputs.subscriptions if self.active and self._live else []

    def configure(self) -> None:
        """Make everything but the inputs."""
        self.found.clear()
        if self._live:
            self.show_found(look_up(self, self.initial_settings(), self._is_stopped))
        settings = self.initial_settings()
        if not self._live:
            settings = replace(settings, record_path='', checkpoint_path='')
        self._prepare(settings)
        # not before: what is refused is one line
        self.get_logger().info(f'rovid {build()}')
        for key, value in self.found.items():
            self.get_logger().info(f'{key}: {value} from {TOPIC}')
        if self.changes:
            change_parameters(self.stream, self.changes)
        self.show({'enable': self.stream.adapting})
        self._join_graph()

    def activate(self) -> None:
        """Subscribe to the inputs."""
        self._inputs = Subscriptions(self, self.settings, self._classes, self.converter.topics,
                                     self._add_batch, self.stream.reject)
        self._health.expect_inputs()
        self._log_inputs()

    def deactivate(self) -> None:
        """Publish what is held and unsubscribe; the estimate stays."""
        self._inputs.receive_all()
        self._publish(self.stream.interrupt())
        self._publish_end()
        self._output_topics.publish_latched()
        self._inputs.close()
        if self.settings.checkpoint_path:
            self._checkpoint.save()
        if self._recorder:
            self._recorder.flush()

    def add_message(self, topic: str, message: Any, receive_time: int) -> list[Estimate]:
        """
        Process a message, received at ``receive_time`` [ns]; return the estimates it releases.

        The topic is as configured, the message of rclpy or of rosbags. The estimates are
        published; there are none while the node is not active.
        """
        if not self.active:
            return []
        return self._add_events(self._decoder.events(topic, message, receive_time))

    def repeat_control(self, name: str, value: str) -> list[Estimate]:
        """Repeat a control that was recorded in a log; return the estimates it releases."""
        if not self.active:
            return []
        estimates = self._publish(repeat_control(self.stream, name, value))
        if name == 'reset':
            self._output_topics.publish_initial()
        if name == PARAMETERS:
            self.show_changes(recorded_changes(value))
        self.show_changes({'enable': self.stream.adapting})
        return estimates

    def receive(self) -> None:
        """Process the messages that wait on the inputs, and publish the estimates."""
        self._inputs.receive()

    def finish(self) -> list[Estimate]:
        """Publish what is held, save the state and end the record; for the end of a run."""
        if not self.configured:
            return []
        if self.active:
            self._inputs.receive_all()
        estimates = self._publish(self.stream.end())
        if self.active and self._live:
            self._publish_end()
        self._output_topics.publish_latched()
        if self.settings.checkpoint_path:
            self.saved = not self._checkpoint.save()
        self._checkpoint.close()
        if self._recorder:
            self._recorder.close()
        self._health.finish()
        self._output_topics.wait(1.0)
        return estimates

    def current_settings(self) -> Settings:
        """Return the settings that a change applies to."""
        return self.settings if self.configured else super().current_settings()

    def apply_changes(self, changes: Mapping[str, Any]) -> None:
        """Go on with other values of live parameters."""
        if self.configured:
            change_parameters(self.stream, changes)
            self._publish([])
        if self.configured and 'checkpoint.period' in changes:
            self._start_saving()

    def _prepare(self, settings: Settings) -> None:
        """Make everything that can be refused; nothing is visible outside yet."""
        self._recorder = Recorder(
            Path(settings.record_path), definition, self.get_logger().error,
            lambda: self.stream.state(), opened=self.get_logger().info,
            max_size=settings.record_max_size, max_duration=settings.record_max_duration,
            found=self.found,
        ) if settings.record_path else None
        self.stream = Stream(settings, recorder=self._recorder, scorer=self._scorer)
        self.converter = Converter(settings, self.stream.reject)
        self._classes = {topic: message_class(settings, self.converter, topic)
                         for topic in self.converter.topics} if self._live else {}
        self._checkpoint = Checkpoint(self.stream, self.get_logger())
        self.resources.callback(self._checkpoint.close)
        self._health = HealthMonitor(
            self, self.stream, self._recorder, self._checkpoint, live=self._live)
        self._silence = StaleEstimates(self, self.stream)
        self._decoder = InputDecoder(
            self.stream, self.converter, self._classes, self._health.arrivals.add,
            self.get_logger(), keep=self._recorder is not None)
        restored = self._checkpoint.restore()
        if self._recorder:
            self._recorder.open(restored)
            self.resources.callback(self._recorder.close)

    def _join_graph(self) -> None:
        """Make publishers, timers and services."""
        self._output_topics = Publishers(self, Outputs(self.settings))
        self.resources.callback(self._output_topics.close)
        self._add_timer(1.0, self._on_second)
        if self._live:
            self._add_timer(STALE_PERIOD, self._on_silence)
        self._start_saving()
        self._add_service(Trigger, '~/reset', self._on_reset)
        self._add_service(SetBool, '~/enable', self._on_enable)
        self._add_service(Trigger, '~/save', self._on_save)
        self.configured = True
        self.resources.callback(setattr, self, 'configured', False)

    def _add_timer(self, period: float, callback: Callable[[], None]) -> Timer:
        timer = self.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.resources.callback(self.destroy_timer, timer)
        return timer

    def _add_service(self, kind: type[Any], name: str, callback: Callable[[Any, Any], Any]
                     ) -> None:
        service = self.create_service(kind, name, callback)
        self.resources.callback(self.destroy_service, service)

    def _start_saving(self) -> None:
        """Save the state every ``checkpoint.period`` from now on."""
        if self._save_timer is not None:
            self.destroy_timer(self._save_timer)
        self._save_timer = self._add_timer(
            self.settings.checkpoint_period, self._on_save_timer) if (
                self.settings.checkpoint_path) else None

    def _add_batch(self, batch: dict[str, list[Received]]) -> None:
        self._add_events(self._decoder.batch_events(batch))

    def _add_events(self, events: Iterable[Event]) -> list[Estimate]:
        return [estimate for event in events for estimate in self._publish(
            self.stream.receive(event))]

    def _publish(self, estimates: list[Estimate]) -> list[Estimate]:
        self._output_topics.publish_estimates(estimates)
        self._health.add_estimates(estimates)
        if estimates:
            self._silence.note_estimate()
        return estimates

    def _publish_end(self) -> None:
        """Say that no DOF has a present velocity any more."""
        last = self.stream.estimate
        end = self.stream.silent_estimate(
            max(last.now, self._silence.newest), ended=True) if last else None
        if end:
            self._output_topics.publish_estimates([end])

    def _on_second(self) -> None:
        self._output_topics.publish_latched()
        self._output_topics.publish(self._health.update(self.label))
        if self._recorder:
            self._recorder.flush()

    def _on_silence(self) -> None:
        """Tell what has happened, and which DOFs have become stale while no step was made."""
        if not self.active:
            return
        estimate = self._silence.due()
        if estimate:
            self._output_topics.publish_estimates([estimate])
        self._health.report_events()

    def _on_save_timer(self) -> None:
        self._checkpoint.begin_saving()

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.stream.reset()
        self._output_topics.publish_initial()
        response.success, response.message = True, 'back at the initial values'
        self.get_logger().info(f'~/reset: {response.message}')
        return response

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.stream.enable(request.data)
        self.show_changes({'enable': request.data})
        response.success = True
        response.message = 'adapting' if request.data else 'frozen'
        self.get_logger().info(f'~/enable: {response.message}')
        return response

    def _on_save(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        failed = self._checkpoint.save()
        response.success = not failed
        response.message = failed or f'saved to {self._checkpoint.path}'
        self.get_logger().info(f'~/save: {response.message}')
        return response

    def _log_inputs(self) -> None:
        """Log the topics of the inputs and the source of each DOF's velocity."""
        log = self.get_logger()
        for topic, type_name in self.converter.topics.items():
            names = ' and '.join(inputs_of(self.settings, topic))
            log.info(f'{names}: {self.resolve_topic_name(topic)} ({type_name})')
        for dof in self.settings.dofs:
            log.info(f'{dof}: velocity from {self.settings.source(dof)}')
        self._publish([])  # logs the warnings so far


class StaleEstimates:
    """
    Tells when steps stay away, which no message can tell.

    Event time goes on from the last step as time does here: with /clock, in which case a paused
    simulation makes nothing stale, or with a clock that is never set. What comes of it depends
    on when this program ran, so it is never in a replay.

    Attributes
    ----------
    newest : int
        Event time [ns] of what was told last.

    """

    def __init__(self, node: Node, stream: Stream) -> None:
        self._node = node
        self._stream = stream
        self._since = self._repeated = self._now()
        self._told: list[str] = []
        self.newest = 0

    def note_estimate(self) -> None:
        """Count from now on: an estimate was published."""
        self._since = self._now()
        self._told = []

    def due(self) -> Estimate | None:
        """Return what has to be published, if there is anything."""
        now = self._now()
        last, elapsed = self._stream.estimate, now - self._since
        if last is None or elapsed < STALE_PERIOD:
            return None
        newest = last.now + round(elapsed * 1e9)
        estimate = self._stream.silent_estimate(newest)
        stale = [dof.dof for dof in estimate.dofs if dof.stale_for] if estimate else []
        if not stale or (stale == self._told and now - self._repeated < STALE_REPEAT):
            return None
        self._told, self._repeated, self.newest = stale, now, newest
        return estimate

    def _now(self) -> float:
        if is_simulated(self._node):
            return self._node.get_clock().now().nanoseconds * 1e-9
        return time.monotonic()
