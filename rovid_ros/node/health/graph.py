"""What the ROS graph says about the topics that a configuration needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import difflib
from typing import Any

from rclpy.node import Node
from rclpy.qos import qos_check_compatible, QoSCompatibility, QoSProfile
from rovid_core.settings.run import Settings
from rovid_ros.config.parameters import inputs_of
from rovid_ros.messages.converter import Converter
from rovid_ros.node.transport.publishers import best_effort
from rovid_ros.results.outputs import COUPLING_TOPICS, CURRENT_TOPICS, TOPICS

LISTED = 3  # largest number of type names in a line; there could be any number in the graph
# What rmw calls a node of which only an endpoint has been discovered yet.
UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'
NAMELESS = 'a publisher'  # how it is called here
SIMILARITY = 0.5  # how similar the names of two topics have to be for a hint


@dataclass(frozen=True)
class TopicState:
    """One topic of the configuration, as the graph has it."""

    # as configured, and in the graph after namespace and remapping
    topic: str
    name: str
    inputs: tuple[str, ...]  # what is read from it
    type: str  # as configured
    publishers: int  # how many can be heard
    problem: str = ''  # '' if some can; ``no_publisher``, ``type``, ``definition`` or ``qos``
    # what is wrong, in one line, with a hint; also about publishers that are not heard beside
    # others that are, and about several that are heard as if they were one
    text: str = ''

    @property
    def is_wrong(self) -> bool:
        """Tell whether somebody has to change something; a publisher may still start."""
        return self.problem not in ('', 'no_publisher')


def graph_states(settings: Settings, node: Node) -> dict[str, TopicState]:
    """
    Compare the graph with the configuration; return the state of each configured topic.

    Where the node has subscribed itself, its profile counts, else the one that hears most.
    """
    converter = Converter(settings, lambda name, reason: None)
    return {topic: _state(topic, type_name, tuple(inputs_of(settings, topic)), node)
            for topic, type_name in converter.topics.items()}


def rivals(node: Node) -> str:
    """
    Return who else publishes the model that a node does, in a line; '' for nobody.

    Names are known later than publishers, and until then there is nothing to say.
    """
    name = node.resolve_topic_name('rov/model')
    found = sorted(map(_node_of, node.get_publishers_info_by_topic(name)))
    return (f'{len(found)} publishers on {name}, whose listeners take them for one: '
            f'{_listed(found)}') if len(found) > 1 and NAMELESS not in found else ''


def _state(topic: str, type_name: str, inputs: tuple[str, ...], node: Node) -> TopicState:
    name = node.resolve_topic_name(topic)
    profile, type_hash = _own(node, name)
    found = node.get_publishers_info_by_topic(name)
    heard: list[str] = []  # by whom it is published
    deaf: dict[str, str] = {}  # problem -> what is wrong with the first publisher that has it
    for publisher in found:
        problem, text = _problem(publisher, type_name, profile, type_hash)
        if problem:
            deaf.setdefault(problem, text)
        else:
            heard.append(_node_of(publisher))
    if not found:
        return TopicState(topic, name, inputs, type_name, 0, 'no_publisher',
                          f'no publisher on {name}{_hint(name, type_name, node)}')
    others = '; '.join(deaf.values())
    if heard:
        lines = [f'{len(found) - len(heard)} of {len(found)} publishers on {name} not heard: '
                 f'{others}'] if deaf else []
        if len(heard) > 1:
            lines.append(f'{len(heard)} publishers on {name} are taken for one: '
                         f'{_listed(sorted(heard))}')
        return TopicState(topic, name, inputs, type_name, len(heard), '', '; '.join(lines))
    if 'type' in deaf:
        types = sorted({publisher.topic_type for publisher in found})
        others = (f'{name} carries {_listed(types)}, not {type_name}'
                  f'{_hint(name, type_name, node)}')
    problem = next(one for one in ('type', 'definition', 'qos') if one in deaf)
    return TopicState(topic, name, inputs, type_name, 0, problem, others)


def _own(node: Node, name: str) -> tuple[QoSProfile, Any]:
    """Return profile and type hash of the node's own subscription."""
    for one in node.get_subscriptions_info_by_topic(name):
        if (one.node_name, one.node_namespace) == (node.get_name(), node.get_namespace()):
            return one.qos_profile, one.topic_type_hash
    return best_effort(1), None


def _problem(publisher: Any, type_name: str, profile: QoSProfile, type_hash: Any
             ) -> tuple[str, str]:
    """Return why a publisher cannot be heard, by name and in words; '' if it can."""
    node = _node_of(publisher)
    if publisher.topic_type != type_name:
        return 'type', f'{node} publishes {publisher.topic_type}, not {type_name}'
    if type_hash is not None and _differs(publisher.topic_type_hash, type_hash):
        return 'definition', (f'{node} publishes {type_name} of another definition than the one '
                              'installed here; build both from the same version')
    compatibility, reason = qos_check_compatible(publisher.qos_profile, profile)
    if compatibility == QoSCompatibility.ERROR:
        words = reason.replace('ERROR: ', '').strip('; ').replace(';', ', ').lower()
        return 'qos', (f'the QoS of {node} does not fit: {words}; with qos: sensor_data every '
                       'publisher is heard')
    return '', ''


def _node_of(publisher: Any) -> str:
    node = f'{publisher.node_namespace.rstrip("/")}/{publisher.node_name}'
    return NAMELESS if UNKNOWN_NODE in node else node


def _differs(one: Any, other: Any) -> bool:
    """Compare two type hashes; one of version -1 is not known."""
    known = one.version > 0 and other.version > 0
    return known and bytes(one.value) != bytes(other.value)


def _hint(name: str, type_name: str, node: Node) -> str:
    """Return a topic that could be meant, '' if none is near."""
    own = {name, *map(node.resolve_topic_name, (*TOPICS, *COUPLING_TOPICS, *CURRENT_TOPICS))}
    topics: Mapping[str, Sequence[str]] = {
        other: types for other, types in node.get_topic_names_and_types()
        if other not in own and node.count_publishers(other)}
    same = [other for other, types in topics.items() if type_name in types]
    near = difflib.get_close_matches(name, same, 1, SIMILARITY) or (same if len(same) == 1 else [])
    if near:
        return f'; did you mean {near[0]}, which has that type?'
    near = difflib.get_close_matches(name, topics, 1, 0.8)
    return f'; {near[0]} has a near name, but is {_listed(topics[near[0]])}' if near else ''


def _listed(names: Sequence[str]) -> str:
    more = f' and {len(names) - LISTED} more' if len(names) > LISTED else ''
    return ', '.join(names[:LISTED]) + more
