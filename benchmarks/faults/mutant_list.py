"""What is broken on purpose: a file, a text that is in it once, another one, and the tests."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mutant:
    """A defect that tests have to notice."""

    what: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]


def _of(file: str, tests: str, *defects: tuple[str, str, str]) -> list[Mutant]:
    """Return the mutants of a file; ``tests`` are files or tests, the latter after ``::``."""
    path, *names = tests.split()
    chosen = tuple(f'{path}::test_{name}' for name in names) or (path,)
    return [Mutant(what, file, old, new, chosen) for what, old, new in defects]


MUTANTS = [
    *_of('rovid_ros/files/whole_files.py', 'test/files/test_power_loss.py',
         ('a file is not brought to the disk',
          'os.fsync(file.fileno())', 'file.fileno()'),
         ('a folder is not brought to the disk',
          'os.fsync(directory)', 'str(directory)'),
         ('a copy is not brought to the disk',
          'os.fsync(new.fileno())', 'new.fileno()'),
         ('a file has its name before it is on the disk',
          'with temporary.open(', 'with path.open('),
         ('a temporary file is left after an error',
          'temporary.unlink(missing_ok=True)', 'pass'),
         ('a spare file is left after an error',
          'spare.unlink(missing_ok=True)', 'pass'),
         ('the state before the newest is not kept',
          'if keep and path.exists()', 'if False')),
    *_of('rovid_ros/files/whole_files.py', 'test/files/test_checkpoint.py',
         ('a lock is not taken',
          'fcntl.flock(', 'str('),
         ('a lock goes by the name of a link',
          'place = Path(os.path.realpath(path))', 'place = path'),
         ('a lock leaves its file',
          'os.unlink(self._path)', 'str()')),
    *_of('rovid_ros/files/state_file.py', 'test/files/test_state_file.py',
         ('the digest is not compared',
          "content.get('sha256', digest) != digest", 'False'),
         ('a digit that does not count may change',
          'parse_float=_exact', 'parse_float=float'),
         ('a digest that is renamed is none',
          'if unknown :=', 'if False and'),
         ('the depth scale may change',
          "'depth.scale', ", ''),
         ('the unit of the heading may change',
          "'attitude.unit',", ''),
         ('the sense of the heading may change',
          "'attitude.heading',", ''),
         ('the thrusters may change',
          "*(f'thrusters.{name}' for name in _FORCE)", ''),
         ('a pipe is read',
          'path.exists() and not path.is_file()', 'False')),
    *_of('rovid_ros/files/state_file.py', 'test/files/test_checkpoint.py',
         ('what began anew overwrites what was learned',
          'if self._stream.reset_by_clock', 'if False'),
         ('a file that does not fit is overwritten',
          '            self._set_aside()', '            pass'),
         ('a state is written twice at once',
          'self._writing is None or not self._writing.is_alive()', 'True'),
         ('a state goes over one that is written',
          '        self._join()\n        return self._attempt', '        return self._attempt'),
         ('of a damaged file the one before is not taken',
          'isinstance(error, DamagedStateError)', 'False')),
    *_of('rovid_ros/commands/replay.py', 'test/commands/test_replay_state.py '
         'a_result_that_cannot_be_printed_leaves_the_state_as_it_was '
         'a_clock_that_goes_back_in_a_log_leaves_what_was_learned',
         ('the result is not out before the state',
          'sys.stdout.flush()', 'pass'),
         ('a replay overwrites what was learned',
          'place_for(args.state, player.stream)', 'args.state')),
    *_of('rovid_ros/commands/running.py', 'test/commands/test_replay_state.py '
         'a_state_that_a_node_uses_is_refused',
         ('a replay takes no lock',
          'lock = FileLock(path)', "lock = FileLock(path.with_name('other'))")),
    *_of('rovid_ros/logs/writer.py', 'test/files/test_power_loss.py',
         ('a finished log is not brought to the disk',
          'if synced:', 'if False:'),
         ('the name of a finished log is not brought to the disk',
          'sync_folder(self._path.parent)', 'pass'),
         ('a record is not brought to the disk',
          'os.fdatasync(self._file.fileno())', 'pass')),
    *_of('rovid_ros/node/recorder.py', 'test/files/test_power_loss.py',
         ('the name of a record is not brought to the disk',
          'sync_folder(self.path.parent)', 'pass')),
    *_of('rovid_ros/node/recorder.py', 'test/node/test_recorder.py',
         ('size is no reason to split',
          'writer.size < largest', 'True'),
         ('a part may be little but its state',
          'max(self._max_size, 2 * self._begins_at)', 'self._max_size'),
         ('time is no reason to split',
          'now - self._since < self._max_duration', 'True'),
         ('a part has no state of its time',
          'self.open(self._state())', 'self.open(None)'),
         ('a part is left without its end',
          'writer.close(synced=True)', 'None')),
    *_of('rovid_ros/logs/log.py', 'test/node/test_recorder.py',
         ('the parts of a record go by their clock',
          'key=_by_run_and_part(self._containers)', 'key=lambda one: one.start')),
    *_of('rovid_ros/logs/sqlite.py', 'test/robustness/test_hostile_files.py '
         'databases_that_make_up_rows_take_no_memory a_database_without_end_is_left_on_ctrl_c '
         'a_message_that_is_too_large_is_told_and_not_fetched',
         ('a view is a table',
          "if kind == 'table' and name", 'if name'),
         ('columns that are computed are read',
          'if any(hidden for', 'if False and any(hidden for'),
         ('a message that is too large is fetched',
          'CASE WHEN length(data) <= {MAX_MESSAGE_SIZE} THEN data END', 'data'),
         ('a query has no end',
          'return self._left < 0', 'return False'),
         ('Ctrl-C is taken for damage',
          'raise KeyboardInterrupt from None', 'raise')),
    *_of('rovid_ros/logs/paths.py', 'test/robustness/test_hostile_files.py '
         'a_pipe_or_a_device_is_no_log '
         'a_bag_with_a_pipe_or_an_impossible_name_reads_the_others '
         'a_bag_whose_list_is_a_pipe_has_no_list',
         ('a pipe is a log',
          'if path.exists() and not path.is_file():', 'if False:'),
         ('a list that is a pipe is waited for',
          'if not list_of_files.is_file()', 'if False'),
         ('one file that cannot be opened spoils the bag',
          '        except OSError as error:\n            warnings',
          '        except MemoryError as error:\n            warnings')),
    *_of('rovid_ros/commands/simulate.py', 'test/robustness/test_hostile_files.py '
         'a_simulation_that_fails_leaves_the_log_that_was_there',
         ('a simulation overwrites the log that was there',
          'OutputLog(path) as writer', 'LogWriter(path) as writer'),
         ('a simulation gives the log no name',
          '    writer.finish()', '    pass')),
    *_of('rovid_ros/commands/running.py', 'test/robustness/test_hostile_files.py '
         'a_closed_stderr_is_no_reason_to_stop',
         ('what cannot be told ends the command',
          '    except OSError:  # Python would', '    except MemoryError:  # Python would')),
    *_of('rovid_ros/commands/running.py', 'test/robustness/test_hostile_files.py '
         'no_file_is_opened_in_place_of_stdout_or_stderr',
         ('a log is opened in place of stderr',
          'os.O_RDWR)) <= 2:', 'os.O_RDWR)) <= 0:')),
    *_of('rovid_ros/commands/main.py', 'test/robustness/test_hostile_files.py '
         'ctrl_c_during_the_imports_is_one_line',
         ('Ctrl-C during the imports is a traceback',
          'except KeyboardInterrupt:', 'except MemoryError:')),
    *_of('rovid_core/pipeline/stream.py', 'test/core/test_saved_state.py '
         'a_state_is_restored_whole_or_not_at_all',
         ('half a state is restored',
          "self.identifier(name).restore(mine['dofs'][name])", 'pass'),
         ('a state does not tell that it is frozen',
          "self._adapt(bool(state.get('adapt', True)))", 'pass')),
    *_of('rovid_core/pipeline/stream.py', 'test/core/test_pipeline.py '
         'reset_enable_and_a_jump_of_time parameters_survive_a_jump_when_told_so '
         'recorded_controls_replay_to_the_same_bits',
         ('a jump of time resets also where it must not',
          'if self.settings.reset_on_time_jump:', 'if True:'),
         ('a jump of time keeps the histories',
          '        self._restart()\n        if self.settings', '        if self.settings'),
         ('that adaptation was stopped is not recorded',
          "self._note('enable', 'true' if adapt else 'false')", 'pass'),
         ('a reset is not recorded',
          "self._note('reset', '')", 'pass'),
         ('a reset resets nothing',
          "        self._note('reset', '')\n        self._pipeline.reset()",
          "        self._note('reset', '')")),
    *_of('rovid_core/pipeline/identification.py', 'test/core/test_pipeline.py '
         'a_step_that_is_refused_is_none_and_says_so',
         ('a step that is refused counts',
          '            self._steps += 1', '            pass\n        self._steps += 1')),
    *_of('rovid_core/pipeline/steps.py', 'test/core/test_pipeline.py '
         'a_step_that_is_refused_is_none_and_says_so one_wild_fix_costs_one_step '
         'what_is_too_fast_costs_one_step_without_a_gate_too '
         'force_and_velocity_go_through_the_same_filter '
         'after_a_gap_filter_and_v_hat_restart_from_the_measurement '
         'no_step_leads_over_a_gap_of_a_velocity_sensor '
         'slow_sampling_clamps_the_cutoff_and_says_so '
         'the_truth_scores_noise_against_the_pipe_and_nothing_against_a_reference '
         'six_dofs_from_fixes_depth_and_attitude_at_their_own_rates',
         ('a step leads over a gap',
          'if last is not None and motion.time - last.time > source.timeout:', 'if False:'),
         ('a wild fix interrupts',
          "if reason not in ('too_fast', 'burst'):", 'if True:'),
         ('the thrust is not filtered',
          'forces = source.force.step(dt, tuple([(q - p) / dt for p, q in zip(first, third)]))',
          'forces = tuple([(q - p) / dt for p, q in zip(first, third)])'),
         ('the parts of a step have the force of the other',
          '(q - p) / lead if', '(q - p) / rest if')),
    *_of('rovid_core/thrust/force_history.py', 'test/core/test_thrust.py '
         'impulse_is_the_exact_integral no_force_before_the_first_command_nor_after_the_timeout '
         'a_direction_is_stale_after_its_timeout '
         'linear_hold_waits_for_the_next_command one_topic_per_thruster_needs_all_of_them '
         'two_topics_of_one_instant_are_one_command '
         'forgetting_changes_no_span one_topic_that_falls_silent_makes_the_force_stale '
         'directions_are_those_of_each_thruster '
         'a_held_force_comes_in_pieces_that_add_up_to_its_integral '
         'what_each_thruster_does_is_no_function_of_the_force',
         ('the delay is an advance',
          'round(settings.delay / NS)', '-round(settings.delay / NS)'),
         ('there is no lag',
          'self._lag = settings.time_constant', 'self._lag = 0.0'),
         ('turns never lag', 'settings.lag_of_turns and self._lag > 0.0', 'False'),
         ('no torque drives turns', 'inertia_of(self._lag, settings.lag_at)', '0.0'),
         ('turns have to come up to the first command', '+ tuple(map(turns_of, tau[bodies:]))',
          '+ tuple(0.0 for _ in tau[bodies:])'),
         ('one topic of several may be silent',
          'oldest = min(', 'oldest = max('),
         ('a delayed command is stale too early',
          'oldest + self._delay + self._timeout', 'oldest + self._timeout'),
         ('linear commands do not wait',
          'self._times[-1] >= time', 'self._times[-1] > time'),
         ('a command is stale at its timeout',
          'else end) > good_until[i]', 'else end) >= good_until[i]'),
         ('two topics of one instant are two commands',
          'if self._times and time == self._times[-1]:', 'if False:'),
         ('pieces of one force are joined with the next',
          'new[j] == held[j] and not', 'new[j] != held[j] and not'),
         ('what each thruster does changes with the force alone',
          'not any(new[k] != held[k] for k in numbers)', 'True'),
         ('the direction is that of the first thruster',
          'signs = signs[part:part + 1]', 'signs = signs[:1]'),
         ('the sign of a magnitude counts twice',
          'math.copysign(abs(u) - offset, s)', '(u - offset) * s'),
         ('a direction is never stale',
          "if time - since > self._timeout:\n                return 'stale_sign'",
          "if False:\n                return 'stale_sign'")),
    *_of('rovid_core/thrust/thruster_curve.py', 'test/core/test_thrust.py '
         'what_each_thruster_does_is_no_function_of_the_force '
         'backwards_is_a_thruster_and_not_what_it_does_to_a_dof',
         ('what runs forwards runs backwards', 'if f < 0.0:', 'if a * f < 0.0:'),
         ('a dead band takes all of a small force', 'a * max(-DEAD_BAND * one, min(f',
          'a * max(-one, min(f')),
    *_of('rovid_core/settings/inputs.py', 'test/core/test_thrust.py '
         'thrusters_that_drive_two_dofs_are_shared',
         ('a thruster without gain is shared', 'any(k * row *', 'any(row *')),
    *_of('rovid_core/identify/ekf/single/delayed_force.py', 'test/core/test_linearised_filter.py '
         'what_each_thruster_did_is_kept_as_long_as_the_force_and_comes_as_late',
         ('what each thruster does stays the same while the force does',
          'not each or each[k] == self._each[-1]', 'True'),
         ('what each thruster did comes before its lag',
          'start -= delay + self._lag', 'start -= delay')),
    *_of('rovid_core/identify/ekf/planar/filter_with_current.py',
         'test/core/test_planar_filter.py '
         'what_one_thruster_does_by_itself_is_what_the_force_of_its_dof_does',
         ('what each thruster takes goes no way of its own',
          'each_way = [scale * (one_way - b * one)', 'each_way = [0.0 * (one_way - b * one)')),
    *_of('rovid_core/identify/ekf/single/linearised_filter.py',
         'test/core/test_linearised_filter.py '
         'what_one_thruster_does_by_itself_is_what_the_force_of_its_dof_does',
         ('what each thruster takes goes no way of its own',
          'cut.path += way - b * cut.push', 'cut.path += 0.0')),
    *_of('rovid_core/identify/ekf/evidence/missing_terms.py', 'test/core/test_ekf_honesty.py '
         'no_thruster_is_far_stronger_backwards_or_pushes_ahead_then',
         ('a thruster pushes ahead that runs backwards', 'if not 0.0 <= 1.0 + kappa',
          'if not 1.0 + kappa')),
    *_of('rovid_core/pipeline/planar_steps.py', 'test/core/test_couplings.py '
         'what_thrusters_lack_that_drive_several_axes_is_told_of_each_of_them',
         ('surge and sway together do not look at each thruster',
          'shares=dof in settings.sharing', 'shares=False')),
    *_of('rovid_core/pipeline/steps.py', 'test/core/test_couplings.py '
         'a_step_says_what_each_thruster_did',
         ('what each thruster did is that of both parts together',
          'split = middle if interval else time', 'split = begin')),
    *_of('rovid_core/thrust/thruster_curve.py', 'test/core/test_thrust.py thruster_models '
         'what_is_far_beyond_the_limit_is_no_command impulse_is_the_exact_integral',
         ('the dead-band ends before its end',
          'abs(command) <= deadband', 'abs(command) < deadband'),
         ('a dead zone takes all of a command',
          'max(abs(command) - dead_zone, 0.0), command', '0.0, command'),
         ('a dead zone pushes the other way', 'abs(command) - dead_zone, 0.0)',
          'abs(command) - dead_zone, -9.0)'),
         ('forwards is backwards',
          'reverse if command < 0.0', 'reverse if command > 0.0'),
         ('a polynomial is read from the other end',
          'for c in reversed(coefficients)', 'for c in coefficients'),
         ('the offset is added',
          'command = (raw - offset) * scale', 'command = (raw + offset) * scale'),
         ('an idle thruster is asked',
          'zip(raw, gains) if k)', 'zip(raw, gains))'),
         ('rows of the allocation go by their place',
          'settings.allocation[DOFS.index(d)] for d in dofs',
          'settings.allocation[i] for i, d in enumerate(dofs)')),
    *_of('rovid_core/model/lowpass.py', 'test/core/test_trajectory.py '
         'the_low_pass_of_a_trial_is_that_of_its_steps '
         'a_cutoff_above_the_rate_of_the_samples_is_clamped',
         ('the cutoff is not clamped',
          'turn = MOST_TURN', 'pass'),
         ('that of a trial is not clamped',
          'np.minimum(2.0 * math.pi * cutoff * dt, MOST_TURN)', '2.0 * math.pi * cutoff * dt'),
         ('the low-pass is that of Euler',
          'weight = -math.expm1(-turn)', 'weight = turn')),
    *_of('rovid_core/model/plant.py', 'test/core/test_trajectory.py '
         'a_trajectory_is_that_of_the_plant signs_and_units_of_the_plant',
         ('the bias pushes forwards',
          '-bias / mass)', 'bias / mass)'),
         ('drag has no direction',
          'k2 = u + beta * w * abs(w)', 'k2 = u + beta * w * w'),
         ('the mass of parameters is alpha',
          'return (1.0 / alpha,', 'return (alpha,')),
    *_of('rovid_core/velocity/attitude_history.py', 'test/core/test_attitude_history.py',
         ('a gap of the attitude is interpolated',
          'if i == 0 or self._times[i] - self._times[i - 1] > self._timeout:', 'if i == 0:'),
         ('an attitude that has jumped is joined with the one before',
          'del self._times[:], self._values[:]', 'pass'),
         ('the attitude between two is the first one',
          '(time - before) / (after - before))', '0.0)'),
         ('an old depth has a speed',
          'time - self._depths[-1][0] > self._depth_timeout', 'False'),
         ('an old position has a speed',
          'time - self.horizontal[0] > self._position_timeout', 'False'),
         ('a heading turns clockwise',
          'math.sin(0.5 * yaw)', '-math.sin(0.5 * yaw)'),
         ('the world is turned into the world',
          'return rotate((-q[0], -q[1], -q[2], q[3]), v)', 'return rotate(q, v)'),
         ('the long way round is taken',
          'if w < 0.0:', 'if w > 0.0:')),
    *_of('rovid_core/velocity/velocity_source.py', 'test/core/test_pipeline.py '
         'what_turning_adds_at_a_dvl_is_taken_off '
         'a_dvl_with_a_lever_arm_does_not_wait_for_a_gyro_that_is_dead',
         ('a DVL never gives up the gyro',
          "if missing == 'later' and now - time <= self._patience:\n            return None\n"
          "        self.waiting.popleft()",
          "if missing == 'later':\n            return None\n        self.waiting.popleft()"),
         ('what the turning adds is added again', 'body = body[0] - x,', 'body = body[0] + x,')),
    *_of('rovid_core/velocity/attitude_history.py', 'test/core/test_pipeline.py '
         'what_turning_adds_at_a_dvl_is_taken_off '
         'a_dvl_with_a_lever_arm_does_not_wait_for_a_gyro_that_is_dead',
         ('the angular velocity is that of the sample before',
          'share = (time - start) / (end - start) if end > start else 0.0', 'share = 0.0'),
         ('a gap of the gyro is a straight line',
          'if rates and time - rates[-1][0] > self.timeout:', 'if False:')),
    *_of('rovid_core/velocity/velocity_source.py', 'test/core/test_pipeline.py '
         'lever_arm_is_taken_off six_dofs_from_fixes_depth_and_attitude_at_their_own_rates '
         'depth_without_heave_still_turns_the_surge '
         'what_one_source_refuses_does_not_reach_the_others',
         ('the lever arm is added',
          'return (value[0] - lx,', 'return (value[0] + lx,'),
         ('the velocity stays in the world',
          'body = rotate_back(attitude, world)', 'body = world'),
         ('the fix gives z where there is a depth',
          'if vertical is None else vertical)', 'if True else vertical)')),
    *_of('rovid_core/velocity/velocity_source.py', 'test/core/test_attitude_history.py',
         ('the time of a mean is its end',
          'Motion(start, end, middle,', 'Motion(start, end, end,'),
         ('what is refused reaches the others',
          'if not (self._is_slow(measured, dt) and self._is_slow(velocity, dt)):', 'if False:')),
    *_of('rovid_core/ordering/event_order.py', 'test/core/test_ordering.py '
         'released_as_soon_as_every_other_input_has_come_as_far '
         'released_at_the_latest_after_max_wait ties_go_in_the_order_of_the_inputs '
         'late_duplicate_and_backward_are_dropped_and_counted '
         'back_by_more_than_time_jump_starts_anew events_that_nothing_releases_are_bounded '
         'a_reference_decides_nothing',
         ('ties go by arrival',
          'RANK[key[0]], self._arrivals', '0, self._arrivals'),
         ('an event waits for one that is later',
          'self._held[0][0] <= until', 'self._held[0][0] < until'),
         ('a duplicate is used',
          'if event.time <= last:', 'if event.time < last:'),
         ('events wait without bounds',
          'if len(self._held) >= MAX_HELD:', 'if False:'),
         ('nothing is late',
          'event.time < max(self._past, newest - self._max_wait)', 'False'),
         ('a reference is waited for',
          'if key in self._inputs and event.time', 'if event.time'),
         ('max_wait is no limit',
          'until = self._newest - self._max_wait', 'until = self._newest - 9 * self._max_wait')),
    *_of('rovid_core/inputs/outlier_gate.py', 'test/core/test_outliers.py '
         'a_jump_is_followed_after_six echoes_that_do_not_agree_are_refused_as_long_as_they_come '
         'outliers_that_do_not_follow_from_each_other_are_never_a_jump '
         'outliers_teach_what_the_noise_has_become',
         ('outliers need not follow from each other',
          'if math.hypot(*innovation) <= self._allowed(outliers, dt):', 'if True:'),
         ('outliers teach nothing',
          'weight *= OUTLIER_WEIGHT', 'weight = 0.0'),
         ('a jump is followed after three',
          'FOLLOW_AFTER: Final = 6', 'FOLLOW_AFTER: Final = 3')),
    *_of('rovid_core/inputs/units_and_signs.py', 'test/core/test_units_and_signs.py '
         'commands_of_two_programs_are_told_once what_looks_like_pulse_widths',
         ('commands of two programs are those of one',
          'if taken_back > BACK * square', 'if False'),
         ('pulse widths are commands',
          'PULSES[0] <= low <= NEUTRAL', 'False and PULSES[0] <= low <= NEUTRAL')),
    *_of('rovid_core/identify/aid/adaptive_identifier.py', 'test/core/test_adaptive_identifier.py '
         'nothing_makes_it_leave_its_bounds '
         'gains_that_are_too_high_for_the_step_are_divided_then_refused '
         'a_frozen_identifier_keeps_mean_and_theta_hat_and_gains '
         'the_rates_are_those_of_the_paper an_integrator_has_its_order '
         'without_adaptation_only_v_hat_moves',
         ('the mass is adapted the wrong way',
          '-gamma[0] * dv * tau', 'gamma[0] * dv * tau'),
         ('the bias is not adapted',
          '-gamma[3] * dv,', '0.0 * dv,'),
         ('the parameters leave their bounds',
          'bottom if p < bottom else top if p > top else p', 'p'),
         ('it adapts where it must not',
          'self._gamma if adapt else self._none', 'self._gamma'),
         ('the integrator is another one',
          'return _shifted(_shifted(x, h / 3.0, k3), h / 6.0, k4)',
          'return _shifted(_shifted(x, h / 3.0, k3), h / 3.0, k4)')),
    *_of('rovid_core/identify/status.py', 'test/core/test_status.py '
         'a_covariance_decides_and_says_what_is_open '
         'between_the_two_limits_it_stays_what_it_was '
         'an_acceleration_that_is_not_known_is_not_converged '
         'refused_frozen_and_unexcited_come_first '
         'a_method_that_does_not_judge_its_errors_has_to_predict_a_minute',
         ('nothing is invalid',
          "return Judgement('invalid', (refused,))", 'return self._judgement'),
         ('what is frozen converges',
          'return FROZEN', 'return self._judgement'),
         ('converged comes and goes',
          'HYSTERESIS: Final = 2.0', 'HYSTERESIS = 1.0'),
         ('a minute need not be predicted',
          'if not (reason or identifier.judges_errors):', 'if False:'),
         ('the acceleration need not be known',
          "('mass', alpha), ('acceleration', share)", "('mass', alpha),")),
    *_of('rovid_core/identify/ekf/normalised_model.py', 'test/core/test_ekf_uncertainty.py',
         ('the covariance is doubled',
          'u * v * self._entry(i, j)', '2.0 * u * v * self._entry(i, j)'),
         ('the deviation of the delay is too large',
          'math.sqrt(self._entry(-1, -1))', '1.5 * math.sqrt(self._entry(-1, -1))'),
         ('the deviations of the couplings are in other units',
          'u * math.sqrt(self._entry(k', 'math.sqrt(self._entry(k')),
    *_of('rovid_core/identify/ekf/evidence/block_fit.py', 'test/core/test_ekf_honesty.py '
         'a_coupling_is_named_that_is_known_better_than_to_what_it_may_be_at_all',
         ('a coupling may be of any size', '**watched.sizes, ', '')),
    *_of('rovid_core/identify/ekf/evidence/block_fit.py', 'test/core/test_unseen_terms.py '
         'what_explains_little_is_named_where_the_mass_depends_on_it',
         ('what explains little is never named', ' or self._matters(name, size, moved, rows)', ''),
         ('what explains little is always named', ' > MATTERS for i in whose',
          ' > 0.0 for i in whose')),
    *_of('rovid_core/identify/ekf/evidence/block_fit.py', 'test/core/test_unseen_terms.py '
         'each_thruster_is_weaker_backwards_only_where_the_data_say_so',
         ('what data say of each thruster is in no interval',
          'by_each = other.evidence > max(own.evidence, SPOKEN)', 'by_each = False'),
         ('a thruster may as well be stronger backwards',
          "begin + BY_EACH.get(term, ''), -1)", "begin + BY_EACH.get(term, ''), 0)"),
         ('each thruster is weaker backwards whatever the data say',
          'by_each = other.evidence > max(own.evidence, SPOKEN)', 'by_each = True')),
    *_of('rovid_core/identify/ekf/evidence/block_fit.py', 'test/core/test_ekf_honesty.py '
         'the_variance_that_blocks_state_is_that_of_a_mean',
         ('the covariance of the blocks is doubled',
          'self.c @ (mixed + self.prior)', '2.0 * self.c @ (mixed + self.prior)'),
         ('the covariance of the blocks is halved',
          'self.c @ (mixed + self.prior)', '0.5 * self.c @ (mixed + self.prior)')),
    *_of('rovid_core/identify/ekf/evidence/block_fit.py', 'test/core/test_ekf_honesty.py '
         'thrust_that_comes_otherwise_than_with_a_lag_leaves_the_mass_open',
         ('all thrust comes and goes as a delay and a lag say',
          'found.t_squared) > OTHERWISE_POWER', 'found.t_squared) > 1e9'),
         ('it is not said that thrust comes otherwise', 'untold.append(begin + OTHERWISE)',
          'pass')),
    *_of('rovid_core/identify/ekf/single/watched_lag.py', 'test/core/test_linearised_filter.py '
         'what_a_lag_takes_of_a_force_that_is_watched_goes_as_it_stays',
         ('a second lag is as the first', '- off * left * h / LAG', '')),
    *_of('rovid_core/identify/ekf/single/linearised_filter.py',
         'test/core/test_linearised_filter.py '
         'a_filter_that_begins_under_way_sees_no_lag_in_the_thrust_there_is',
         ('what lags is at rest where the filter begins',
          '_watched_lag.begin(force - excess, first)', '_watched_lag.begin(0.0, 0.0)')),
    *_of('rovid_core/identify/ekf/single/linearised_filter.py', 'test/core/test_ekf_honesty.py '
         'turns_that_lag_are_told_from_a_force_that_does',
         ('what lags is under way where a filter begins at rest',
          '_watched_lag.begin(force - excess, first)', '_watched_lag.begin(first, first)')),
    *_of('rovid_core/identify/ekf/planar/filter_with_current.py',
         'test/core/test_planar_filter.py '
         'a_filter_that_begins_under_way_sees_no_lag_in_the_thrust_there_is',
         ('what lags is at rest where the filter of two begins',
          'self.lag.begin(force - excess, self.before)', 'self.lag.begin(0.0, 0.0)')),
    *_of('rovid_core/identify/ekf/evidence/block_fit.py', 'test/core/test_ekf_honesty.py '
         'what_is_found_missing_first_does_not_hide_the_rest',
         ('what is found missing hides the rest',
          'whole = self._with(left.pop(missing.name))', 'left.clear()')),
    *_of('rovid_core/identify/ekf/evidence/block_fit.py', 'test/core/test_ekf_honesty.py '
         'thrust_that_falls_as_a_battery_runs_down_is_said_and_the_interval_holds_it',
         ('a battery that runs down is not seen', 'if seen is None:', 'if True:'),
         ('what the thrust was before and after does not widen the interval',
          'np.outer(middle, middle) + np.outer(gained, gained) / 12.0', '0.0')),
    *_of('rovid_core/identify/ekf/evidence/block_fit.py', 'test/core/test_ekf_honesty.py '
         'no_battery_runs_down_that_does_not',
         ('chance runs a battery down', 'if not (seen.is_significant and -2.0 < '
          'seen.kappa.item() <= -MATTERS):', 'if False:')),
    *_of('rovid_core/identify/ekf/evidence/block_fit.py', 'test/core/test_ekf_honesty.py '
         'thrust_falls_by_no_more_than_all_of_it',
         ('a battery gives less than nothing', '-2.0 < seen.kappa', '-9.0 < seen.kappa'),
         ('the share that is lost is that of the mean', 'float(gained[first] / begin[first])',
          'float(share)')),
    *_of('rovid_core/identify/ekf/evidence/score_blocks.py', 'test/core/test_ekf_honesty.py '
         'thrust_that_goes_on_falling_is_no_change',
         ('a battery that runs down is a change', 'DRIFT**2]', '0.0]')),
    *_of('rovid_core/identify/ekf/planar_kalman.py', 'test/core/test_current.py '
         'thrust_that_falls_is_told_of_both_at_once',
         ('the mass of surge is said for sway', 'row.first, row.end))',
          '0, self._model.rows[0].end))')),
    *_of('rovid_core/velocity/couplings.py', 'test/core/test_current.py '
         'what_a_dof_has_of_its_own_does_not_wait_for_the_current',
         ('what a DOF has of its own is a product of velocities',
          'tuple([name for name in names if name not in OF_FORCES])', 'names')),
    *_of('rovid_core/pipeline/steps.py', 'test/commands/test_six_axes.py '
         'in_a_tank_the_noise_of_fixes_does_not_make_yaw_heavier',
         ('in still water yaw is coupled with differences of fixes',
          'self._couplings.add_filtered(', 'str(')),
    *_of('rovid_core/pipeline/steps.py', 'test/core/test_current.py '
         'yaw_is_coupled_with_the_velocity_through_the_water',
         ('yaw is coupled with a velocity over ground',
          'ways[0], ways[1] = [(at, u) for at, u, _ in both], [(at, v) for at, _, v in both]',
          'pass')),
    *_of('rovid_core/pipeline/steps.py', 'test/core/test_current.py '
         'what_yaw_learned_beside_velocities_that_were_not_found_yet_does_not_count',
         ('what was coupled with differences of fixes counts',
          'self._is_found(source) and not was_found', 'False'),
         ('what yaw learned by itself is forgotten', '.identifier.kept <= kept',
          '.identifier.kept <= math.inf')),
    *_of('rovid_core/identify/ekf/planar_kalman.py', 'test/core/test_current.py '
         'between_slow_fixes_yaw_is_coupled_with_what_the_model_makes_of_the_thrust',
         ('between slow fixes velocities go straight',
          'if not is_long(step.dt):', 'if True:')),
    *_of('rovid_core/identify/ekf/extended_kalman.py', 'test/core/test_current.py '
         'between_slow_fixes_yaw_is_coupled_with_what_the_model_makes_of_the_thrust',
         ('between slow fixes in still water velocities go straight',
          'is_long(step.dt) and self._way', 'False')),
    *_of('rovid_core/identify/ekf/between_fixes.py', 'test/core/test_current.py '
         'between_slow_fixes_yaw_is_coupled_with_what_the_model_makes_of_the_thrust',
         ('what a fix tells is there at once',
          'old + k * more', 'old')),
    *_of('rovid_core/identify/ekf/planar/filter_with_current.py', 'test/core/test_current.py '
         'what_looks_like_a_current_is_named_with_its_size',
         ('a sensor ahead swings the other way',
          '-6:] += turn * wx, -turn * sx', '-6:] += -turn * wx, turn * sx'),
         ('a sensor to port swings the other way',
          '-6:] += turn * wy, -turn * sy', '-6:] += turn * wy, turn * sy')),
    *_of('rovid_core/identify/ekf/evidence/current_status.py', 'test/core/test_current.py '
         'what_fits_better_is_said_also_where_it_hides_the_current',
         ('what hides the current is not said', 'better.advice or THRUST', 'THRUST')),
    *_of('rovid_core/identify/ekf/filter_bank.py', 'test/core/test_ekf_honesty.py '
         'what_is_left_out_does_not_stand_at_a_bound',
         ('nothing stands at its upper bound', 'not low < theta[i] < high', 'not low < theta[i]'),
         ('what is left out stands at a bound', 'spread[i][i] > 0.0 and ', '')),
    *_of('rovid_core/identify/aid/full_gain.py', 'test/core/test_adaptive_identifier.py '
         'a_gamma_that_is_not_positive_is_no_crash',
         ('a Gamma may be negative', 'if not linear > 0.0:', 'if False:')),
    *_of('rovid_core/velocity/turning_rate.py', 'test/core/test_turning_rate.py',
         ('a turn has all noise of its attitudes', 'self.gain / dt * innov', '1.0 / dt * innov'),
         ('the worst filter of the attitudes counts',
          'one.square < least', 'one.square > least * 0.0'),
         ('after a pause a turn goes on from before', 'if count == 1:', 'if False:')),
    *_of('rovid_core/identify/ekf/evidence/current_status.py', 'test/core/test_current.py '
         'a_sensor_ahead_of_the_middle_is_no_coupling_with_the_yaw_thrust',
         ('a sensor that is not in the middle is a coupling',
          'missing.name.split()[-1] in THRUSTS', 'False')),
    *_of('rovid_core/identify/ekf/planar/member.py', 'test/core/test_current.py '
         'a_sensor_ahead_of_the_middle_is_no_coupling_with_the_yaw_thrust',
         ('a coupling is named beside the sensor that it looks like',
          'found = replace(found, missing=None)  # it only', 'pass  # it only')),
    *_of('rovid_core/identify/ekf/planar_kalman.py', 'test/core/test_current.py '
         'a_velocity_of_the_other_handedness_is_named',
         ('a right velocity is of the other handedness', 'max(one, other) < 0.0', 'True'),
         ('no velocity is of the other handedness', 'max(one, other) < 0.0', 'False')),
    *_of('rovid_core/settings/inputs.py', 'test/commands/test_survey.py '
         'a_log_without_the_field_costs_a_row',
         ('an error of a setting does not come from another process',
          'super().__init__(key, message)', "super().__init__(f'{key}: {message}')")),
    *_of('rovid_core/inputs/outlier_gate.py', 'test/core/test_couplings.py '
         'without_a_gate_the_turns_are_filtered_as_well',
         ('a gate of 0 knows no turns', 'change = self.change = self._change(good.value, value)',
          'change = self._change(good.value, value)\n        '
          'self.change = change if self._limit else None')),
    *_of('rovid_core/inputs/outlier_gate.py', 'test/core/test_outliers.py '
         'without_the_gate_they_do',
         ('a gate of 0 refuses', 'not self._limit or', '')),
    *_of('rovid_core/ordering/event_order.py', 'test/core/test_ordering.py '
         'nobody_waits_for_a_reference_that_comes_late',
         ('a reference lets the others wait', 'key in self._inputs and lag <=',
          'lag <= FAR')),
    *_of('rovid_core/pipeline/stream.py', 'test/core/test_slow_fixes.py '
         'a_wait_that_has_grown_outlasts_a_change_of_other_settings',
         ('any change takes back a wait that has grown',
          'if settings.max_wait != self.settings.max_wait:', 'if True:')),
    *_of('rovid_ros/comparison/trials.py', 'test/commands/test_replay_state.py '
         'a_record_that_began_from_a_state_of_another_method_is_replayed_and_compared',
         ('methods are compared from a state',
          'log alone tells them."""\n        return \'\'',
          'log alone tells them."""\n        return super().restore(state)')),
    *_of('rovid_ros/logs/writer.py', 'test/files/test_power_loss.py '
         'an_output_log_has_its_name_when_it_is_on_the_disk',
         ('an output is closed before it is on the disk',
          'self._close()\n        if self._part != self._path and not',
          'self.close()\n        if self._part != self._path and not')),
    *_of('rovid_core/thrust/force_history.py', 'test/core/test_thrust.py '
         'the_mean_force_on_some_dofs_is_of_what_is_known',
         ('a mean force begins before the commands', 'start = max(start, self._times[0])', ''),
         ('a mean force before the commands is asked for',
          'not self._times or self._times[0] >= end', 'not self._times')),
    *_of('rovid_core/pipeline/steps.py', 'test/core/test_couplings.py '
         'thrust_beside_the_centre_of_mass_is_named_and_found',
         ('the thrust on another DOF is not watched',
          'self._forces.means(*seen, source.watched_thrusts)',
          '[0.0] * len(source.watched_thrusts)'),
         ('the thrust on another DOF is no regressor',
          'self._forces.means(*span, source.thrusts)', '[0.0] * len(source.thrusts)')),
    *_of('rovid_core/velocity/couplings.py', 'test/core/test_couplings.py '
         'a_gyro_says_how_fast_the_vehicle_turns_where_there_is_one',
         ('couplings do without the gyro',
          'if settings.angular_velocity.topic else', 'if False else')),
    *_of('rovid_core/velocity/couplings.py', 'test/core/test_couplings.py '
         'attitudes_stand_in_for_a_gyro_that_dies',
         ('nothing stands in for a gyro', 'not self._has_attitude or end', 'True or end')),
    *_of('rovid_core/pipeline/steps.py', 'test/core/test_couplings.py '
         'a_gyro_and_the_fixes_do_not_wait_for_each_other',
         ('what a gyro says is not there at once',
          'self._couplings.add_rates(time, rates, jumped)', 'str()')),
    *_of('rovid_core/identify/ekf/planar/row.py', 'test/core/test_current.py '
         'the_velocity_of_the_filter_is_that_of_its_stamp',
         ('the velocities of surge and sway are behind a low-pass',
          'filtered = False', 'filtered = True')),
    *_of('rovid_core/identify/ekf/single/linearised_filter.py', 'test/core/test_reverse.py',
         ('the drag in reverse slows down forwards too',
          'if k >= 0 and goes_back else 0.0', 'if k >= 0 else 0.0'),
         ('weaker thrust in reverse has no rise',
          'weaker * (3.0 * mean - 6.0 * moment)', '0.0')),
    *_of('rovid_core/identify/ekf/planar/filter_with_current.py', 'test/core/test_reverse.py',
         ('surge and sway forget weaker thrust in reverse',
          'rest += weaker * push.reverse / h', 'pass')),
    *_of('rovid_core/trials/scored_run.py', 'test/core/test_reverse.py',
         ('reverse thrust is scored forwards',
          'np.minimum(values[:, :2], 0.0)', 'np.maximum(values[:, :2], 0.0)')),
    *_of('rovid_core/trials/joint_simulation.py', 'test/core/test_reverse.py',
         ('rows together have no drag in reverse',
          'min(beta + reverse, 0.0) if reverse else beta', 'beta')),
    *_of('rovid_core/pipeline/steps.py', 'test/commands/test_tune.py '
         'a_current_is_no_weaker_thrust_in_reverse',
         ('what is coupled moves against the water',
          'replaced(body=(u - a, v - b, w - c))', 'replaced(body=(u + a, v + b, w - c))')),
    *_of('rovid_ros/commands/tune.py', 'test/commands/test_tune.py '
         'a_current_is_no_weaker_thrust_in_reverse',
         ('tuning takes the water to be still',
          'found[tried.yaw_offset] = finder.log.water', 'pass')),
    *_of('rovid_core/trials/tuning/clocks.py', 'test/core/test_tuning.py '
         'a_latency_that_only_turns_want_is_not_taken',
         ('tuning takes a latency that predicts worse', 'if _predicts_better(', 'if bool(')),
    *_of('rovid_core/trials/tuning/cross_validation.py', 'test/core/test_tuning.py '
         'a_latency_that_only_turns_want_is_not_taken',
         ('a latency that stays is not among those that are as good',
          'Change(change.before, change.before)', 'replace(change, after=change.before)')),
    *_of('rovid_core/trials/tuning/tune.py', 'test/core/test_thruster_likelihood.py '
         'what_is_too_fast_for_blocks_the_filter_may_say',
         ('what blocks told of the thrusters is told beside what the filter says',
          'if not one.keys.keys() & stage.keys.keys()]', ']'),
         ('the delay that the filter found is left out',
          'told.delay if math.isnan(found.delay) else', 'told.delay if True else')),
    *_of('rovid_core/trials/tuning/tune.py', 'test/core/test_thruster_likelihood.py '
         'what_blocks_clearly_tell_stays',
         ('blocks cannot contradict the filter', 'if choose(errors, 0).is_better:', 'if False:')),
    *_of('rovid_core/trials/tuning/likelihood.py', 'test/core/test_thruster_likelihood.py',
         ('the filter may predict a DOF worse', '[2] >= -WORTH for', '[2] >= -9.0 for'),
         ('gains by chance are taken', 'gain > WORTH and low > 0.0', 'gain > 0.0'),
         ('what changes nothing is taken', '<= tried.score(best) + WORTH:', '<= -1e9:'),
         ('the lag of turns is not tried', 'else (False, True)', 'else (False,)'),
         ('what the filter loses is taken', 'prediction.errors.keys() >= {*self.dofs}', 'True'),
         ('other values lie above all that was tried', '2.0 * values[i] - values[i - 1]',
          'values[i]')),
    *_of('rovid_core/identify/ekf/thruster_search.py', 'test/core/test_thruster_likelihood.py '
         'the_filter_predicts_best_with_the_thrusters_that_there_are',
         ('thrusters that are as configured are searched for', 'not self._pace or', '')),
    *_of('rovid_core/identify/ekf/filter_bank.py', 'test/core/test_thruster_likelihood.py '
         'the_filter_predicts_best_with_the_thrusters_that_there_are',
         ('how sure a prediction is does not count',
          'self.surprise = surprise(normalised, found.total)',
          'self.surprise = surprise(normalised, 1.0)')),
    *_of('rovid_core/trials/tuning/tune.py', 'test/core/test_reverse.py '
         'tuning_adds_the_drag_and_leaves_the_thrust_to_the_thrusters',
         ('drag that is larger in reverse makes weaker thrusters', 'own.errors)], 0).is_better',
          'own.errors)], 0).index > 1')),
    *_of('rovid_core/trials/tuning/heading.py', 'test/core/test_tuning.py '
         'a_latency_that_only_turns_want_is_not_taken a_latency_that_is_known_changes_no_mass',
         ('no mass is owed to a latency', 'if np.abs(masses).max() >', 'if masses.max() >'),
         ('every latency changes a mass too much', '.masses[0], MASS_KNOWN)', '.masses[0], 0.0)')),
    *_of('rovid_core/trials/tuning/timing.py', 'test/core/test_tuning.py '
         'an_input_whose_dofs_answer_later_than_all_others_is_late',
         ('no input comes late', 'if len({*sources}) < 2:', 'if len({*sources}) < 9:'),
         ('an input is late by all of the delay',
          'pairs[i][0] - pairs[j][0]', 'pairs[i][0] + 0.1')),
    *_of('rovid_core/trials/tuning/cross_validation.py', 'test/core/test_tuning.py',
         ('a part without steps counts', '~np.isnan(own[0])', '(own[0] == own[0]) | True'),
         ('a gain may cost a DOF', 'return bool(mean < -width)', 'return bool(mean > width)'),
         ('large errors count more than small ones', 'scores = sum(np.log(np.maximum(',
          'scores = sum((np.maximum(')),
    *_of('rovid_core/trials/tuning/searches.py', 'test/core/test_tuning.py '
         'a_term_that_is_missing_is_added',
         ('no term is added', 'candidates[choice.index] if choice.is_better', 'before if True')),
    *_of('rovid_core/trials/tuning/searches.py', 'test/core/test_tuning.py '
         'finds_a_dead_zone',
         ('no dead zone is looked for', "'dead_zone': small, ", ''),
         ('what all thrusters share is looked for once', 'FINER = 2', 'FINER = 1')),
    *_of('rovid_ros/commands/tune.py', 'test/commands/test_tune.py '
         'warns_of_the_settings_in_use_alone',
         ('what is only tried is warned of', 'tried is not settings or', 'False or')),
    *_of('rovid_core/trials/tuning/clocks.py', 'test/core/test_tuning.py '
         'with_another_heading_the_log_is_read_again_and_couplings_are_sought',
         ('another heading leaves the log as it was read',
          'heading is not None and heading.changes:', 'False:')),
    *_of('rovid_core/trials/tuning/log.py', 'test/core/test_tuning.py '
         'turns_alone_tell_how_late_fixes_are',
         ('fixes that are late are turned by a later attitude',
          'one.ends - round(late / NS)', 'one.ends + round(late / NS)')),
    *_of('rovid_core/trials/tuning/timing.py', 'test/core/test_tuning.py',
         ('a latency that is found is not waited for',
          'if 0.0 <= settings.max_wait < wait', 'if 0.0 <= settings.max_wait < 0.0'),
         ('commands that are late have a delay below 0',
          'if delay < 0.0:', 'if delay < -9.0:')),
    *_of('rovid_core/trials/tuning/timing.py', 'test/core/test_tuning.py '
         'commands_are_late_only_where_no_dof_says_otherwise',
         ('one DOF that answers early makes late commands', 'late.is_better and all(',
          'late.is_better and any(')),
    *_of('rovid_core/trials/tuning/cross_validation.py', 'test/core/test_tuning.py '
         'a_fix_a_second_finds_the_delay_of_thrust_that_changes_sooner',
         ('the second between two fixes is one step',
          'max(1, round(float(np.median([', 'min(1, round(float(np.median([')),
    *_of('rovid_core/velocity/velocity_source.py', 'test/core/test_attitude_history.py',
         ('an angle does not drift by the noise of the others',
          "(self._needs_attitude or self.input == 'attitude')", 'self._needs_attitude')),
    *_of('rovid_core/identify/ekf/thruster_search.py', 'test/core/test_ekf_honesty.py '
         'drag_in_reverse_is_not_looked_for_in_the_thrusters',
         ('drag in reverse is looked for in the thrusters',
          'better not in named and not is_drag', 'better not in named'),
         ('thrust in reverse is not looked for', 'is_drag = drag.endswith(REVERSE_DRAG) and (',
          'is_drag = (')),
    *_of('rovid_ros/discovery/thrusters.py', 'test/discovery/test_init.py '
         'a_thruster_that_holds_the_depth_does_not_drive_ahead',
         ('a push that stays the same drives',
          'changes = (commands - np.sum(shares * commands, axis=0)) / strength',
          'changes = commands / strength'),
         ('what is not known of thrusters together tells them apart',
          'known = sizes > doubts', 'known = sizes > 0.0')),
    *_of('rovid_core/identify/ekf/evidence/unseen_terms.py', 'test/core/test_unseen_terms.py',
         ('weaker thrust backwards is instead of all else',
          "('thrust_loss', 'reverse_thrust')", "('thrust_loss',)"),
         ('a dead band is of no size', "'dead_band': (alpha,", "'dead_band': (0.0,"),
         ('a term that data exclude is as likely as before',
          '- math.log1p(power))', '+ 0.0 * power)')),
    *_of('rovid_core/identify/ekf/evidence/block_fit.py', 'test/core/test_unseen_terms.py '
         'two_kinds_of_lag_make_a_dead_band_no_less_likely',
         ('each kind of lag is as likely as a dead-band', 'weight=WEIGHTS.get(term, 1.0)',
          'weight=1.0')),
    *_of('rovid_core/identify/ekf/thruster_search.py', 'test/core/test_ekf_honesty.py '
         'a_lag_that_another_dof_shows_is_taken_where_it_fits '
         'a_lag_that_another_dof_shows_has_to_be_no_more_than_likelier',
         ('a lag of another DOF has to be clearly better', ' and better not in told', ''),
         ('a lag of another DOF is not looked for', '_told(bank.best.thrusters, heard)', 'False'),
         ('a lag at a force is heard as a lag', 'thrusters.lag and not thrusters.lag_at',
          'thrusters.lag')),
    *_of('rovid_core/identify/ekf/planar_kalman.py', 'test/core/test_current.py '
         'surge_and_sway_take_a_lag_that_another_dof_shows',
         ('surge and sway are deaf', 'self._heard if self._free else Heard()', 'Heard()')),
    *_of('rovid_core/pipeline/identification.py', 'test/core/test_identification.py '
         'what_one_dof_shows_of_the_thrusters_the_others_hear',
         ('a DOF hears itself', 'if other.identifier is not self.identifier:', 'if True:')),
    *_of('rovid_core/pipeline/identification.py', 'test/core/test_identification.py '
         'a_change_that_one_dof_shows_the_others_look_for',
         ('a change is told to nobody', 'if self._changed_at > changed_at:', 'if False:')),
    *_of('rovid_core/pipeline/identification.py', 'test/core/test_identification.py '
         'thrust_that_another_dof_shows_to_be_less_is_in_the_interval',
         ('what others show of the thrust is in no interval',
          'if not share else', 'if True else')),
    *_of('rovid_core/identify/status.py', 'test/core/test_status.py '
         'what_a_dof_cannot_see_of_the_thrusters_it_is_told',
         ('thrust is in doubt where the DOF shows it itself', 'if self._of_others() else 0.0',
          'if self._weaker else 0.0')),
    *_of('rovid_core/identify/ekf/filter_bank.py', 'test/core/test_identification.py '
         'a_change_that_one_dof_shows_the_others_look_for',
         ('a change that is expected has to be as sure as any', 'EXPECTED if', 'FALSE_ALARM if'),
         ('a change is expected for ever', 'self._expecting -= 1', 'pass')),
    *_of('rovid_core/identify/ekf/between_fixes.py', 'test/core/test_between_fixes.py '
         'a_span_has_equal_parts_and_what_is_left_by_rounding_none',
         ('a force acts in what rounding leaves', '(begin - end - NS) / LONGEST',
          '(begin - end) / LONGEST')),
    *_of('rovid_core/identify/ekf/evidence/unseen_terms.py', 'test/core/test_unseen_terms.py '
         'the_interval_is_that_of_the_average_over_vehicles_with_and_without',
         ('all terms are as likely before any data', 'term.weight / whole *',
          '1.0 / len(terms) *')),
    *_of('rovid_core/identify/ekf/evidence/block_fit.py', 'test/core/test_unseen_terms.py '
         'thrust_may_fall_by_what_the_data_do_not_show',
         ('thrust that the data do not show to fall stays', 'own + averaged(ways, own)', 'own'),
         ('what thrust falls by is not what moves the mean',
          'for leaning in (begin, begin + drift.thrust[self.active])',
          'for leaning in (0.0 * begin, 0.0 * begin)')),
    *_of('rovid_core/identify/ekf/evidence/vehicle_change.py', 'test/core/test_ekf_honesty.py '
         'a_load_that_is_dropped_after_two_minutes_is_a_change',
         ('that the model is right counts for nothing', 'min(2 * freedom, FEW)', '0')),
    *_of('rovid_core/simulation/vehicle.py', 'test/core/test_profiles.py '
         'thrusters_that_push_less_astern_are_asked_for_more',
         ('what pushes less astern is asked for as much', 'f / reverse)', 'f)'),
         ('there is as much thrust astern', '-reverse * most, most', '-most, most')),
    *_of('rovid_core/simulation/vehicle.py', 'test/core/test_profiles.py '
         'what_a_dead_zone_takes_is_commanded_besides',
         ('nothing is commanded for a dead zone', '**root + lost', '**root'),
         ('no thrust is commanded to move', 'if f == 0.0 or f < 0.0', 'if f < 0.0'),
         ('a dead zone takes nothing of the most', 'limit - lost', 'limit'),
         ('the end of a table is not reached', 'ends = lost + max', 'ends = max')),
    *_of('rovid_core/pipeline/steps.py', 'test/core/test_tuning.py '
         'commands_that_the_pipe_refuses_are_not_tuned_with',
         ('a scorer hears of no command', 'if raw and self._scorer is not None', 'if False')),
    *_of('rovid_core/identify/ekf/filter_bank.py', 'test/core/test_ekf_honesty.py '
         'what_loses_the_vehicle_before_there_is_a_verdict_counts_after_a_change_only',
         ('after a change losses do not count',
          'self.changed_at > 0.0 if member', 'False if member')),
    *_of('rovid_core/identify/ekf/thruster_search.py', 'test/core/test_ekf_honesty.py '
         'a_lag_of_the_thrusters_is_found_and_said a_lag_that_no_thruster_has_is_not_taken '
         'turns_that_lag_are_told_from_a_force_that_does '
         'the_likeliest_lag_is_found_wherever_the_first_one_is',
         ('nothing is ever found of the thrusters', 'if value < least:\n                    '
          'least, taken', 'if False:\n                    least, taken'),
         ('a force lags', 'likelier < least - margin', 'False'),
         ('turns lag', 'likelier < least - margin', 'True'),
         ('a lag is never longer than the first', 'return min(BEYOND * best, DELAYS[1])',
          'return best')),
    *_of('rovid_core/model/lag.py', 'test/core/test_linearised_filter.py '
         'the_force_of_propellers_whose_turns_lag_is_that_of_short_steps',
         ('propellers never turn back', 'if turns * end >= 0.0:', 'if True:'),
         ('those that turn back did nothing before', '- way - before', '- 0.0 * way - before'),
         ('what a torque stops turns on', 'if x <= still:', 'if True:'),
         ('a torque has turned nothing before', '- inertia * (way - begin * length)',
          '- inertia * way')),
    *_of('rovid_core/model/lag.py', 'test/core/test_score.py '
         'the_thrust_lags_as_the_method_says',
         ('in scores a lag is forgotten from block to block',
          'added[..., :1] += decay[:1] * begin', 'added[..., :1] += decay[:1] * steady[..., :1]')),
    *_of('rovid_core/model/lag.py', 'test/core/test_thrust.py '
         'propellers_give_the_same_in_many_spans_at_once',
         ('in scores propellers never turn back', 'turns * end < 0.0', 'turns * end < -1e9'),
         ('in scores a torque stops turns on', 'np.where(x <= still, root',
          'np.where(x < 1e9, root')),
    *_of('rovid_core/trials/scored_run.py', 'test/core/test_score.py '
         'the_thrust_lags_as_the_method_says',
         ('scores have a lag as a delay, too', 'delay - thrusters.lag)', 'delay)'),
         ('scores know no turns', 'if thrusters.turns and not inertia:', 'if False:'),
         ('scores know no torque', 'if thrusters.turns and not inertia:', 'if thrusters.turns:')),
    *_of('rovid_core/identify/ekf/thruster_search.py', 'test/core/test_ekf_honesty.py '
         'propellers_that_a_torque_drives_are_told_from_those_that_turn_as_asked',
         ('no torque is looked for', 'if _kind(before) != TORQUE and', 'if False and'),
         ('each size begins where the passes were last',
          'ends[min(ends, key=lambda end: abs(end - lag))]', 'ends[list(ends)[-1]]')),
    *_of('rovid_core/trials/tuning/timing.py', 'test/core/test_tuning.py '
         'tells_propellers_whose_turns_lag_from_a_force_that_does',
         ('the other kind of lag is never taken',
          'not (choice.index and choice.is_better) or choice.contradicted:',
          'True:'),
         ('the other kind of lag is always taken',
          'not (choice.index and choice.is_better) or choice.contradicted:',
          'False:'),
         ('no torque is tried', 'Kind(True, torque)):', 'Kind(True, 0.0)):')),
    *_of('rovid_core/trials/tuning/log.py', 'test/core/test_tuning.py '
         'the_force_of_a_log_is_that_of_the_pipe',
         ('in tuning a torque drives nothing', 'inertia_of(lag, self._lag_at)', '0.0'),
         ('in tuning what a torque turns is held',
          'all_driven(begin, force[i], x, inertia) - begin', '0.0 * begin')),
    *_of('rovid_core/identify/ekf/single/delayed_force.py', 'test/core/test_linearised_filter.py '
         'the_force_of_propellers_whose_turns_lag_is_that_of_short_steps',
         ('of turns the force in reverse has no lag', 'if self._turns:\n                force',
          'if False:\n                force')),
    *_of('rovid_core/identify/ekf/thruster_search.py', 'test/core/test_ekf_honesty.py '
         'nothing_is_found_of_the_thrusters_that_they_do_not_have '
         'what_the_thrusters_lose_is_found_and_said '
         'what_follows_another_axis_is_not_taken_for_the_thrusters',
         ('what is hardly likelier is found', 'value += _margin(bank.best)', 'value -= 1e9'),
         ('what a wrong model scatters makes nothing less likely',
          'MARGIN * member.verdict.unexplained', 'MARGIN')),
    *_of('rovid_core/identify/ekf/single/linearised_filter.py',
         'test/core/test_linearised_filter.py '
         'thrust_that_falls_with_speed_is_linear_drag_under_a_force_that_stays',
         ('thrust falls with speed by the force', 'math.sqrt(abs(force)) * w', 'abs(force) * w')),
    *_of('rovid_core/identify/ekf/single/linearised_filter.py',
         'test/core/test_linearised_filter.py sensitivities_are_derivatives_of_the_motion',
         ('the mass does not feel what is lost with speed', 'of_alpha - slowing(force) * w',
          'of_alpha'),
         ('nor does the delay', 'rise = last - before - (', 'rise = last - before - 0.0 * (')),
    *_of('rovid_core/trials/scored_run.py', 'test/core/test_reverse.py '
         'what_is_lost_with_speed_counts_in_every_score',
         ('what is lost with speed is not in a score', 'parameters[0] * thrusters.loss', '0.0'),
         ('nor in one of all rows together', 'slowing=thrusters.slowing(row[0])',
          'slowing=0.0')),
    *_of('rovid_core/identify/ekf/planar/filter_with_current.py',
         'test/core/test_planar_filter.py '
         'thrust_that_falls_with_speed_is_linear_drag_under_a_force_that_stays',
         ('so it does in surge and sway', 'math.sqrt(abs(force)) * w', 'w')),
    *_of('rovid_core/identify/ekf/thruster_search.py', 'test/core/test_ekf_honesty.py '
         'what_the_thrusters_lose_is_found_and_said',
         ('what an unknown force follows is not found of the thrusters',
          '(bank.best, bank.members[0])', '(bank.best,)')),
    *_of('rovid_core/identify/ekf/batch_start.py', 'test/core/test_ekf_honesty.py '
         'thrusters_that_are_no_better_are_not_tried_again_at_once',
         ('thrusters are tried again and again', 'self.duration >= self.failed + PERIOD',
          'True')),
    *_of('rovid_core/identify/ekf/thruster_search.py', 'test/core/test_ekf_honesty.py '
         'a_search_goes_through_little_at_a_time_and_a_log_that_ends_has_all_of_it '
         'what_is_found_of_the_thrusters_goes_on_after_a_restore',
         ('a search holds up the step that begins it', 'self._left -= part', 'pass'),
         ('a restored search begins again', 'for _ in range(self._gone):', 'for _ in ():'),
         ('what was measured meanwhile is not gone through',
          'if not finish(bank.go_through_again(start, (), False)):', 'if False:')),
    *_of('rovid_core/identify/ekf/extended_kalman.py', 'test/core/test_ekf_honesty.py '
         'a_search_goes_through_little_at_a_time_and_a_log_that_ends_has_all_of_it',
         ('a log that ends leaves a search undone', ' or self._search_for(math.inf)', '')),
    *_of('rovid_core/identify/ekf/evidence/missing_terms.py', 'test/core/test_ekf_honesty.py '
         'a_lag_that_no_thruster_has_is_not_taken a_lag_gets_longer_or_is_one_of_something_else '
         'what_the_thrusters_lose_is_found_and_said',
         ('a lag that no thruster has is taken', 'if lag > DELAYS[1]:', 'if False:'),
         ('a lag begins anew', 'now.lag * now.lag + ', ''),
         ('what lags is never something else', 'if now.lag and now.turns != turns:', 'if False:'),
         ('a dead band is half as wide', 'now.dead_band - share *',
          'now.dead_band - 0.5 * share *'),
         ('reverse thrust begins anew', 'now.reverse * (1.0 + share)', '1.0 + share')),
    *_of('rovid_core/identify/ekf/evidence/block_fit.py', 'test/core/test_ekf_honesty.py '
         'a_lag_of_the_thrusters_is_found_and_said',
         ('a lag that was found is known exactly', 'for name in watched.found if name in left}',
          'for name in watched.found if False}')),
    *_of('rovid_core/identify/ekf/evidence/verdict.py', 'test/core/test_ekf_honesty.py '
         'what_the_thrusters_lose_is_found_and_said',
         ('what was found keeps its first size', 'if self.missing else self.rest',
          'if self.missing else ()')),
    *_of('rovid_core/identify/ekf/evidence/current_status.py', 'test/core/test_current.py '
         'a_coupling_that_is_missing_comes_before_what_looks_like_a_current',
         ('a coupling that is missing is taken for a latency',
          'if is_coupling(missing) and not may_be_an_arm:', 'if False:')),
    *_of('rovid_core/inputs/configuration_check.py', 'test/core/test_configuration_check.py '
         'components_of_a_wrench_are_not_exchanged',
         ('components of a wrench are exchanged', '() if is_wrench else', '')),
    *_of('rovid_core/inputs/configuration_check.py', 'test/core/test_configuration_check.py '
         'a_mistake_is_named thrust_that_only_holds_a_dof_accuses_nothing '
         'the_law_is_the_one_that_fits_best_of_those_that_a_vehicle_has',
         ('what would be negative stays', '[:, :len(signed)] < 0.0, axis=1)',
          '[:, :len(signed)] < -1e9, axis=1)'),
         ('what is held accuses', 'HOLDING: Final = 0.0316', 'HOLDING: Final = 0.0'),
         ('beside a GPS the heading is off by another quarter',
          'self._with_signs(turned), quarter=1,', 'self._with_signs(turned), quarter=3,')),
    *_of('rovid_core/identify/ekf/extended_kalman.py', 'test/core/test_ekf.py '
         'what_begins_after_minutes_of_rest_is_gone_through_again',
         ('the start ends whatever it says', 'start.is_enough(known) and',
          'start.is_much() and')),
    *_of('rovid_core/identify/ekf/batch_start.py', 'test/core/test_current.py '
         'a_start_among_fixes_that_say_little_goes_on_until_they_say_enough',
         ('a few slow fixes end the start', 'known and self.duration > LONGEST or',
          'self.duration > LONGEST or')),
    *_of('rovid_core/identify/ekf/planar_kalman.py', 'test/core/test_current.py '
         'the_velocity_between_slow_fixes_turns_with_the_body',
         ('after a fix the body goes on turning as it did', 'if before < ahead and pieces:',
          'if before < 0.0:')),
    *_of('rovid_core/identify/ekf/single/delayed_force.py', 'test/core/test_linearised_filter.py '
         'the_force_of_a_step_is_kept_for_the_next_one_however_long_both_take',
         ('thrust between slow fixes is forgotten', 'bisect_right(times, last - KEPT)',
          'bisect_right(times, times[-1] - KEPT)')),
    *_of('rovid_core/identify/ekf/planar_kalman.py', 'test/core/test_current.py '
         'yaw_begins_anew_with_what_it_has_where_there_is_a_current',
         ('no current is one', '> KNOWN_CURRENT)', '> -1.0)')),
    *_of('rovid_core/identify/ekf/extended_kalman.py', 'test/core/test_current.py '
         'yaw_begins_anew_with_what_it_has_where_there_is_a_current',
         ('what begins anew begins at the guess',
          'self._begin(self._model.of(self.parameters))', 'self._begin(self._model.initial)')),
    *_of('rovid_core/inputs/units_and_signs.py', 'test/core/test_units_and_signs.py '
         'a_glitch_decides_no_typical_size',
         ('a glitch is a typical size', 'SELDOM: Final = 0.01', 'SELDOM: Final = 0.0')),
    *_of('rovid_ros/discovery/candidates.py', 'test/discovery/test_init.py '
         'a_pressure_is_in_the_unit_that_a_vehicle_can_dive_in',
         ('a vehicle dives at any speed', 'and not _dives_too_fast(signal)', '')),
    *_of('rovid_ros/discovery/thrusters.py', 'test/discovery/test_what_drives.py '
         'of_thrusters_that_are_driven_together_those_that_are_driven_most_push_most',
         ('all that are driven together push as much',
          'alphas -= free @', 'alphas -= 0.0 * free @')),
    *_of('rovid_ros/discovery/thrusters.py', 'test/discovery/test_what_drives.py '
         'a_thruster_that_answers_to_the_motion_a_little_does_not_drive_it',
         ('what is not known to push is known not to', 'patterns[:, may_push], apart', 'apart')),
    *_of('rovid_ros/discovery/thrusters.py', 'test/discovery/test_what_drives.py '
         'a_pattern_that_is_known_to_push_nothing_is_no_pattern_that_may_push',
         ('what is known not to push may push', '~known & (doubts > _SMALL * sizes.max())',
          '~known')),
    *_of('rovid_core/identify/ekf/evidence/current_status.py', 'test/core/test_current.py '
         'a_current_is_known_once_it_is_judged_whether_it_is_one',
         ('a current is known before it is judged', 'is_judged and std <', 'std <')),
    *_of('rovid_core/identify/ekf/evidence/current_status.py', 'test/core/test_current.py '
         'after_a_change_the_vehicle_is_found_anew_and_the_current_stays',
         ('a change forgets that the current was known', 'was_known or math', 'math')),
    *_of('rovid_core/identify/ekf/evidence/missing_terms.py', 'test/core/test_ekf_honesty.py '
         'a_delay_as_there_hardly_is_one_has_not_converged',
         ('any delay is one', 'if verdict.theta[k] > HARDLY:', 'if False:')),
    *_of('rovid_ros/discovery/lever_arm.py', 'test/discovery/test_what_drives.py '
         'a_dvl_that_is_not_in_the_middle_shows_in_turns',
         ('an arm is found at once', '_ROUNDS = 6', '_ROUNDS = 1')),
    *_of('rovid_ros/discovery/decisions.py', 'test/discovery/test_init.py '
         'the_rough_model_counts_with_couplings_and_fixes_in_time_are_not_late',
         ('an arm is taken whatever it explains', 'if with_arm <= without or', 'if')),
    *_of('rovid_ros/discovery/decisions.py', 'test/discovery/test_what_drives.py '
         'a_dvl_that_is_not_in_the_middle_shows_in_turns',
         ('the arm of a velocity goes without a gyro',
          " or name == 'velocity' and not found.get('angular_velocity')", '')),
    *_of('rovid_ros/discovery/decisions.py', 'test/discovery/test_what_drives.py '
         'heave_of_a_vehicle_that_pitches_is_not_how_fast_its_depth_changes',
         ('heave is how fast the depth changes',
          "velocities['heave'] = replace(moved, velocities=velocities).heaving()", 'pass')),
    *_of('rovid_ros/discovery/thrusters.py', 'test/discovery/test_init.py '
         'a_name_decides_what_the_motion_leaves_open',
         ('a speed needs as much evidence as a force', '2.0 if words & _SPEEDS',
          '1.0 if words & _SPEEDS')),
    *_of('rovid_ros/discovery/thrusters.py', 'test/discovery/test_init.py '
         'motors_that_are_known_push_the_way_they_point',
         ('motors that are known push any way', 'if made.sure_frame:', 'if False:')),
    *_of('rovid_ros/discovery/decisions.py', 'test/discovery/test_init.py '
         'a_controller_whose_commands_are_stamped_late_pushes_along',
         ('a controller that brakes is accused', 'if sign < 0 and _goes_along(', 'if False and ('),
         ('no sign is ever accused', '>= push.explained:', '>= -9.0:')),
    *_of('rovid_ros/discovery/decisions.py', 'test/discovery/test_init.py '
         'commands_that_are_samples_of_faster_ones_hold_from_halfway_since_the_last',
         ('every command that is logged was given then', 'if best < len(_DELAYS) or gained',
          'if best < 99 or gained'),
         ('slow commands are samples of faster ones',
          'if best < len(_DELAYS) or gained <= found[best].by_chance(SURE**2):', 'if False:')),
    *_of('rovid_ros/logs/dataflash.py', 'test/logs/test_dataflash.py '
         'what_an_autopilot_writes_is_no_damage',
         ('columns that are numbers are damage', 'if column.isdigit() else column',
          'if False else column'),
         ('a lone record is damage', '(right | in_order).all()', 'right.all()')),
    *_of('rovid_core/inputs/units_and_signs.py', 'test/core/test_units_and_signs.py '
         'a_force_of_rounding_is_no_typical_size',
         ('a force of rounding is a typical size', 'size < ROUNDING * used', 'False')),
    *_of('rovid_core/identify/ekf/extended_kalman.py', 'test/core/test_ekf_honesty.py '
         'what_is_found_of_the_thrusters_goes_on_after_a_restore',
         ('a restored filter forgets the thrusters', "read_thrusters(state['thrusters'])",
          'AS_CONFIGURED')),
    *_of('rovid_core/identify/ekf/planar_kalman.py', 'test/core/test_current.py '
         'what_is_found_of_the_thrusters_goes_on_with_the_same_bits',
         ('surge and sway find nothing of the thrusters',
          'self._search.begin(self._bank, self._start, heard, self.state)', 'pass'),
         ('a search of surge and sway is forgotten',
          "self._search.restore(state['search'])", 'pass')),
    *_of('rovid_core/model/thrusters.py', 'test/core/test_reverse.py '
         'what_is_found_of_the_thrusters_is_in_every_result',
         ('forward thrust is never the weaker one', 'min(1.0, 1.0 / self.reverse)', '1.0'),
         ('a controller asks for no more where there is less',
          'force / (ahead if force > 0.0 else astern)', 'force')),
    *_of('rovid_core/trials/scored_run.py', 'test/core/test_reverse.py '
         'what_is_found_of_the_thrusters_is_in_every_result',
         ('a score knows nothing of the thrusters', 'if thrusters.is_curved:', 'if False:')),
    *_of('rovid_core/identify/ekf/single/delayed_force.py', 'test/core/test_linearised_filter.py '
         'the_force_that_there_is_is_less_by_a_dead_band_and_backwards',
         ('what was asked for before goes on as it was',
          'thrusters.given(self._thrusters.asked(mean))', 'mean')),
    *_of('rovid_core/identify/ekf/single/free_prediction.py', 'test/core/test_ekf_honesty.py '
         'hovering_tells_nothing_of_the_fit coarse_fixes_tell_the_fit_whatever_their_noise_is',
         ('the fit is that of noise where nothing moves',
          'return max(error, square) > most * noise', 'return True'),
         ('a motion that was predicted and did not come is forgotten',
          'max(error, square) >', 'square >'),
         ('a motion that came and was not predicted is forgotten',
          'if self._tells(total):', 'if self._tells(total) and not self.fit > 0.0:'),
         ('coarse fixes of a motion tell nothing',
          'math.sqrt(2.0 / count) if', '9.0 if')),
    *_of('rovid_core/identify/ekf/evidence/missing_terms.py', 'test/core/test_ekf_honesty.py '
         'clocks_are_judged_by_delay_and_lag_together',
         ('a lag makes a delay look early', 'verdict.theta[k] + lag', 'verdict.theta[k]')),
    *_of('rovid_ros/discovery/thrusters.py',
         'test/discovery/test_init.py a_frame_with_reversed_motors_is_recognised',
         ('a frame that a part of the DOFs speaks for is taken as it stands',
          'found, most = made, ours + EXPLAINED', 'found, most = made, 9.0')),
    *_of('rovid_core/identify/ekf/evidence/missing_terms.py', 'test/core/test_ekf_honesty.py '
         'a_lag_is_said_in_seconds_up_to_what_a_configuration_takes',
         ('a lag is said in minutes', 'if lag <= LONGEST_LAG else', 'if True else')),
    *_of('rovid_core/identify/ekf/single/delayed_force.py', 'test/core/test_linearised_filter.py '
         'the_force_behind_a_lag_is_that_of_short_steps',
         ('a lag moves the way by the impulse that was asked for',
          'moment += self._lag * (first * (end - start) - impulse)',
          'moment += 0.0 * impulse')),
    *_of('rovid_core/identify/ekf/extended_kalman.py', 'test/core/test_ekf_honesty.py '
         'what_changed_may_change_back',
         ('a parameter near 0 stays there',
          'max(abs(p), abs(q))', 'abs(p)')),
    *_of('rovid_core/settings/run.py', 'test/core/test_pipeline.py '
         'each_velocity_is_from_the_most_direct_input',
         ('a gyro is not used',
          "('angular_velocity', 'attitude')", "('attitude', 'angular_velocity')"),
         ('a depth is not used',
          "('velocity', 'depth', 'position')", "('velocity', 'position', 'depth')")),
    *_of('rovid_ros/messages/converter.py', 'test/messages/test_convert.py',
         ('NED is turned like a body',
          'return (float(y), float(x), -float(z))', 'return (float(x), -float(y), -float(z))'),
         ('FRD has its left on the right',
          'return (float(x), -float(y), -float(z))', 'return (float(x), float(y), -float(z))'),
         ('a compass counts the other way',
          'sign, zero = (-1.0, 0.5 * math.pi)', 'sign, zero = (1.0, 0.5 * math.pi)'),
         ('degrees are radians',
          'yaw = zero + sign * unit * float(value)', 'yaw = zero + sign * float(value)'),
         ('the latency is added',
          'time - source.latency', 'time + source.latency'),
         ('the offset of the depth is subtracted',
          'scale * float(value) + offset', 'scale * float(value) - offset'),
         ('what is not estimated is used',
          'if variance == -1.0:', 'if False:'),
         ('an empty stamp is a time',
          'if seconds or nanoseconds:', 'if True:'),
         ('joints go by their place',
          'there.index(name) for name in names', 'i for i, name in enumerate(names)'),
         ('an attitude in NED stays in NED',
          'q = (s * (x + y), s * (x - y), s * (w - z), s * (w + z))', 'pass')),
    *_of('rovid_ros/results/dof_encoder.py', 'test/results/test_outputs.py',
         ('an invalid row is published',
          "if estimate.status in ('invalid', 'stale'):", 'if False:'),
         ('a coupling that a row does not have is 0',
          'known.get(name, math.nan)', 'known.get(name, 0.0)'),
         ('deviations stay',
          'if uncertainty is not self._std_of:', 'if not self._std:'),
         ('reasons stay',
          'if dof.judgement is not self._said_of or dof.stale_for:', 'if not self._said:')),
    *_of('rovid_ros/results/outputs.py', 'test/results/test_outputs.py',
         ('the standard deviations are the parameters',
          'encode([dof.std for dof in dofs])', 'encode([dof.parameters for dof in dofs])'),
         ('what is not identified stands still',
          '[math.nan] * len(DOFS)', '[0.0] * len(DOFS)'),
         ('v_hat and force are exchanged',
          '[dof.force for dof in dofs]', '[dof.v_hat for dof in dofs]'),
         ('what is invalid is a warning',
          "'invalid': ERROR", "'invalid': WARN")),
    *_of('rovid_ros/results/outputs.py', 'test/results/test_outputs.py',
         ('a reset keeps the rows of before',
          'self._take(self._nothing)', 'pass'),
         ('what is stale for long is a warning',
          'ERROR if dof.stale_for > LONG else LEVELS[dof.status]', 'LEVELS[dof.status]')),
    *_of('rovid_ros/results/wire_encoding.py', 'test/results/test_wire_encoding.py',
         ('the last row comes first',
          '[self._start, *rows]', '[self._start, *reversed([*rows])]'),
         ('velocity and effort are exchanged',
          '*velocity, self._count, *effort', '*effort, self._count, *velocity')),
    *_of('rovid_ros/results/dof_encoder.py', 'test/results/test_model.py',
         ('how late they are is exchanged',
          'dof.velocity_delay, dof.v_hat_delay,', 'dof.v_hat_delay, dof.velocity_delay,'),
         ('all is valid',
          'float(dof.valid)', '1.0'),
         ('a deviation stands before its number',
          'alpha, alpha_std, beta,', 'alpha_std, alpha, beta,'),
         ('what is stale has no age',
          'return dof.stale_for or (now - dof.time) * 1e-9',
          'return (now - dof.time) * 1e-9 if not dof.stale_for else 0.0')),
    *_of('rovid_ros/model.py', 'test/results/test_model.py',
         ('a reverse thrust does not count',
          'alpha = self.alpha + reverse', 'alpha = self.alpha'),
         ('drag pushes when it goes backwards',
          '[self.beta * velocity * abs(velocity)', '[self.beta * velocity * velocity'),
         ('the columns go by their place',
          "label.startswith('kappa_') and not label.endswith('_std')",
          "label.startswith('kappa_') and label.endswith('_std')")),
    *_of('rovid_ros/results/current.py', 'test/results/test_current.py',
         ('a current in NED is told in ENU',
          "if frames == 'enu':", 'if True:'),
         ('of a current in NED the covariance is that in ENU',
          'covariance=(yy, xy, xx)', 'covariance=(xx, xy, yy)')),
    *_of('rovid_ros/logs/static_frames.py', 'test/logs/test_static_frames.py',
         ('a sensor is where its parent is turned from',
          'return (rotate_back(p, (f[0] - b[0]', 'return (rotate(p, (f[0] - b[0]'),
         ('turns hang together the wrong way',
          'turn = product(rotation, turn)', 'turn = product(turn, rotation)')),
    *_of('rovid_core/velocity/couplings.py', 'test/core/test_couplings.py '
         'with_them_the_coupled_plant_is_linear_in_what_is_measured '
         'restoring_terms_are_those_of_the_attitude '
         'the_parts_of_a_step_lie_in_one_interval_between_fixes_each '
         'a_mean_does_not_go_on_over_an_interval_that_is_missing',
         ('a roll to the left is one to the right',
          '*rates, up[1], -up[0]', '*rates, -up[1], -up[0]'),
         ('a rate is the turn of the interval',
          'return (x / dt, y / dt, z / dt)', 'return (x, y, z)'),
         ('a mean goes on over an interval that is missing',
          'means[-1][1] != start', 'False')),
    *_of('rovid_core/pipeline/identification.py', 'test/core/test_staleness.py',
         ('what was before a jump of time is fresh',
          'not (silent or self._interrupted)', 'not silent'),
         ('what is stale has a velocity',
          'velocity=nan, v_hat=nan', 'velocity=estimate.velocity, v_hat=nan'),
         ('what will never have a step is stale',
          "if estimate.judgement.status == 'waiting':", 'if False:')),
    *_of('rovid_core/pipeline/stream.py', 'test/core/test_settings_change.py '
         'an_interruption_starts_the_histories_anew',
         ('an interruption keeps the histories',
          "self._note('interrupt', '')\n        self._order.restart()\n        self._restart()",
          "self._note('interrupt', '')\n        self._order.restart()")),
    *_of('rovid_core/ordering/cadence.py', 'test/core/test_slow_fixes.py '
         'a_gap_is_five_usual_intervals a_pause_is_no_interval',
         ('the usual interval is the longest',
          'intervals[len(intervals) // 2]', 'intervals[-1]'),
         ('a pause is an interval',
          '        self._last = None\n\n    def', '        pass\n\n    def')),
    *_of('rovid_core/inputs/stuck_sensor.py', 'test/core/test_outliers.py '
         'no_step_leads_over_the_time_that_a_sensor_was_stuck '
         'without_thrust_a_value_may_repeat',
         ('a sensor is stuck without thrust',
          'if not _is_driven(forces, self._own_least_forces):', 'if False:'),
         ('what was stuck goes on as if nothing had been',
          "self.gate.restart_from(time, value)\n                return 'gap'", 'pass')),
    *_of('rovid_core/identify/aid/full_gain.py', 'test/core/test_adaptive_identifier.py '
         'w_never_grows_however_long_the_step',
         ('it learns in the wrong direction',
          'p - impulse * g for p, g', 'p + impulse * g for p, g'),
         ('the drag is that at the start of the step',
          'phi = (tau, w * abs(w), w, 1.0, *self._regressors(others, w))',
          'phi = (tau, v * abs(v), v, 1.0, *self._regressors(others, v))')),
    *_of('rovid_ros/node/transport/publishers.py', 'test/node/test_node_live.py '
         'names_and_qos a_reset_shows_at_once',
         ('what is latched is not',
          'latched() if topic in LATCHED else reliable(DEPTH)', 'reliable(DEPTH)')),
    *_of('rovid_ros/node/node.py', 'test/node/test_node_live.py '
         'a_reset_shows_at_once',
         ('a reset does not show',
          'self.stream.reset()\n        self._output_topics.publish_initial()',
          'self.stream.reset()')),
    *_of('rovid_ros/node/node.py', 'test/node/test_node_live.py '
         'a_failed_save_is_not_the_end',
         ('a last save that failed is none',
          'self.saved = not self._checkpoint.save()', 'self._checkpoint.save()')),
    *_of('rovid_ros/node/node.py', 'test/node/test_node.py '
         'what_waits_when_it_is_deactivated_counts',
         ('what waits is lost when it is deactivated',
          '        self._inputs.receive_all()\n        self._publish(self.stream.interrupt())',
          '        self._publish(self.stream.interrupt())')),
    *_of('rovid_ros/node/node.py', 'test/node/test_node.py '
         'an_inactive_node_has_no_velocity',
         ('an inactive node has a velocity',
          'self._publish_end()\n        self._output_topics.publish_latched()\n'
          '        self._inputs.close()',
          'self._output_topics.publish_latched()\n        self._inputs.close()')),
    *_of('rovid_ros/node/lifecycle.py', 'test/node/test_lifecycle.py '
         'a_transition_that_fails_halfway_undoes_what_it_did '
         'requests_that_fail_or_do_not_fit_the_state',
         ('a transition that fails leaves half of it',
          '            undo()\n', '            pass\n')),
    *_of('rovid_ros/node/parameters.py', 'test/node/test_live_parameters.py '
         'all_or_nothing_with_what_is_not_live refused_as_the_file_would_be',
         ('all can be set at any time',
          'or own_values([self.get_parameter(name)])[name] != shown.get(name)}', 'and False}')),
    *_of('rovid_ros/node/parameters.py', 'test/node/test_live_parameters.py '
         'what_is_set_is_told_and_what_stays_as_it_is_is_not '
         'what_ros2_param_takes_for_text_is_a_number',
         ('what stays as it is is told',
          'if value != before[name]]', 'if True]'),
         ('nothing that is set is told',
          '                self.get_logger().info(line)', '                pass'),
         ('a number without a point is text',
          'return _number(parameter)', 'return value')),
    *_of('rovid_ros/node/parameters.py', 'test/node/test_live_parameters.py '
         'back_from_raw_gains_without_a_restart',
         ('a list cannot be deleted',
          'Parameter.Type.STRING_ARRAY):\n        return []',
          'Parameter.Type.STRING_ARRAY):\n        return None')),
    *_of('rovid_ros/node/process.py', 'test/node/test_node.py '
         'parameter_files_on_the_command_line '
         'the_command_line_wins_over_what_a_file_has_for_rclpy',
         ('the first file wins',
          'values.update(load(file, name, namespace))',
          'values = {**load(file, name, namespace), **values}'),
         ('what a file has for rclpy wins over the command line',
          "rest[1:1] = ['--ros-args',", "rest[len(rest):] = ['--ros-args',")),
    *_of('rovid_ros/node/health/console.py', 'test/node/test_diagnostics.py',
         ('what comes and goes is told each time',
          'if not seen.silenced or now - seen.told < REPEAT:', 'if not seen.silenced:'),
         ('what goes again soon and stays away is not told',
          'seen.silenced = False, now, True',
          'seen.silenced = False, now, now > seen.told + REPEAT')),
    *_of('rovid_ros/node/node.py', 'test/node/test_silence.py',
         ('silence is not told',
          'if last is None or elapsed < STALE_PERIOD:', 'if True:')),
    *_of('rovid_core/identify/ekf/planar/member.py', 'test/core/test_planar_filter.py '
         'fixes_that_come_fast_are_one_measurement_of_their_mean',
         ('each of the fixes that come fast is a measurement',
          'and at - self._last >= LEAST_INTERVAL', 'and at - self._last >= 0.0'),
         ('what is along the way to the mean of fixes is what is along all of them',
          'self._along.take((end - start) / count)', 'self._along.take(1e9)')),
    *_of('rovid_core/identify/ekf/single/measurements.py', 'test/core/test_linearised_filter.py '
         'fixes_that_come_fast_are_one_measurement_of_their_mean',
         ('what is along the way to the mean of fixes is what is along all of them',
          'self._along.take(end - start)', 'self._along.take(1e9)'),
         ('what is left of the way is forgotten', 'part[0] -= used', 'del self._parts[0]')),
    *_of('rovid_core/identify/ekf/single/measurements.py', 'test/core/test_linearised_filter.py '
         'how_couplings_rise_goes_by_the_intervals_around',
         ('how couplings rise goes by the interval before alone',
          '[mean for _, mean in step.couplings] if step.interval', '[] if False')),
    *_of('rovid_core/identify/ekf/planar_kalman.py', 'test/core/test_couplings.py '
         'they_belong_to_the_span_of_a_measurement',
         ('no force acts from a measurement to the end of its step',
          'recent.over(recent.end - ahead, recent.end, own[-1])[0] / ahead', '0.0')),
    *_of('rovid_core/identify/ekf/single/linearised_filter.py',
         'test/core/test_linearised_filter.py '
         'a_coupling_that_rises_pushes_as_it_does_in_short_steps',
         ('what a coupling rises by moves nothing', 'du += one.value * regressor', 'du += 0.0'),
         ('what a coupling rises by is no part of its sensitivity',
          'one.push += more * rise', 'one.push += 0.0'),
         ('a coupling stays at its mean in all parts of a step',
          'mean + (2 * k + 1 - pieces) * rise', 'mean')),
    *_of('rovid_ros/discovery/candidates.py', 'test/discovery/test_init.py '
         'thrusters_may_have_a_topic_each',
         ('left and right are two kinds of thrusters', 'if word not in _SIDES', 'if word')),
    *_of('rovid_ros/discovery/handedness.py', 'test/discovery/test_init.py',
         ('fixes that are mostly noise replace a depth',
          'math.sqrt(2.0) * noise_of(', '0.0 * noise_of(')),
    *_of('rovid_ros/discovery/handedness.py', 'test/discovery/test_what_drives.py '
         'a_dvl_with_y_to_the_right_shows_in_turns_or_by_the_depth',
         ('turns tell nothing of a velocity', 'if abs(kappa) > SURE * error:', 'if False:'),
         ('a velocity is mirrored where it is right', "'' if kappa < 0.0", "'' if kappa > 0.0"),
         ('a depth tells nothing of a velocity', "if against else ''", "if False else ''"),
         ('it is always known how fast a vehicle turns', 'seen_from_middle(moved, 0.0)', 'moved')),
    *_of('rovid_ros/discovery/candidates.py', 'test/discovery/test_init.py '
         'joints_may_be_thrusters_by_their_topic_or_names',
         ('names of joints are no names', 'if not (named or words', 'if not (words')),
    *_of('rovid_ros/discovery/decisions.py', 'test/discovery/test_init.py',
         ('slow fixes go before a DVL', 'velocity.rate > position.rate', 'False'),
         ('a delay that is left open makes fixes late',
          'told[least].left + told[least].by_chance(SURE**2)', 'told[least].left + 1e-9'),
         ('fixes are late against the thrust',
          'enumerate(found) if one.push > SURE', 'enumerate(found)')),
    *_of('rovid_ros/discovery/moments.py', 'test/discovery/test_init.py',
         ('each latency has a noise of its own',
          '[case.fit(noise) for case', '[case.fit(case.fit().noise) for case')),
    *_of('rovid_ros/discovery/candidates.py', 'test/discovery/test_init.py '
         'a_point_that_never_moves_sideways_is_a_depth',
         ('every point is a depth', 'np.ptp(signal.values[:, :2]) > 0.0', 'False')),
    *_of('rovid_core/identify/ekf/planar/filter_with_current.py', 'test/core/test_current.py '
         'what_looks_like_a_current_is_named_with_its_size',
         ('late fixes are not seen', '-sx * du - wx * dv', '0.0')),
    *_of('rovid_core/identify/ekf/evidence/current_status.py', 'test/core/test_current.py '
         'a_latency_that_is_off_is_within_the_intervals',
         ('a latency that is told is exact', 'DOUBTED_LATENCY = 0.25', 'DOUBTED_LATENCY = 1e-9')),
    *_of('rovid_ros/discovery/thrusters.py', 'test/discovery/test_init.py',
         ('all commands are forces', 'return speeds', 'return forces'),
         ('thrust may explain motion against it',
          'math.copysign(push.explained, push.alphas[0])', 'push.explained')),
    *_of('rovid_ros/discovery/motion.py', 'test/commands/test_six_axes.py',
         ('the axes do not push each other where init looks',
          'for name in COUPLINGS[dof] if', 'for name in () if')),
    *_of('rovid_ros/discovery/motion.py', 'test/discovery/test_init.py',
         ('a current pushes nothing where init looks',
          'return [np.cos(self.turned), np.sin(self.turned)]', 'return []')),
    *_of('rovid_core/settings/inputs.py', 'test/commands/test_six_axes.py '
         'what_no_motion_of_a_dof_shows_another_tells_it',
         ('a row of thrusters hides nothing',
          'return min(row) < 0.0 < max(row)', 'return False')),
    *_of('rovid_core/settings/inputs.py', 'test/core/test_thrust.py '
         'which_dofs_hide_weaker_thrust_backwards',
         ('a motor that turns the other way hides nothing',
          'share * gain for share, gain in zip', 'share for share, _ in zip')),
    *_of('rovid_core/identify/status.py', 'test/core/test_status.py '
         'what_a_dof_cannot_see_of_the_thrusters_it_is_told '
         'of_a_wrench_any_dof_may_hide_it '
         'a_dof_that_finds_what_it_pushes_backwards_needs_no_other',
         ('what another DOF shows does not count',
          'self._of_others() or own', 'own'),
         ('what a DOF shows itself counts twice',
          'or self._name in self._weaker:', 'or False:'),
         ('what a DOF has in its model it is told all the same', 'if has or not', 'if not'),
         ('a DOF may be used that names what it does not take into account',
          'if _names(identifier, own) else', 'if False else'),
         ('what was forgotten still counts for the others',
          'self._weaker.pop(self._name, None)\n        self._was_excited',
          'self._was_excited')),
    *_of('rovid_core/simulation/vehicle.py', 'test/config/test_stock_vehicles.py '
         'simulated_thrusters_hear_the_whole_numbers_that_are_sent',
         ('simulated thrusters hear what is not sent', 'if self._whole:', 'if False:')),
    *_of('rovid_core/inputs/units_and_signs.py', 'test/core/test_units_and_signs.py '
         'thrusters_that_push_both_ways_or_not_at_all_need_no_sign',
         ('what thrusters push both ways asks for a sign', 'if not self._one_way[i]:',
          'if False:')),
    *_of('rovid_core/identify/ekf/planar_kalman.py', 'test/core/test_current.py '
         'the_first_intervals_hold_what_nothing_tells_yet',
         ('the first intervals hold what is told alone',
          'covariance = covariance + np.array(unseen)', 'pass')),
    *_of('rovid_core/identify/ekf/planar/row.py', 'test/core/test_current.py '
         'how_much_each_model_predicts_is_told',
         ('the fit of surge and sway is not told', 'return self._filter.fit(self.k)',
          'return math.nan')),
    *_of('rovid_ros/messages/converter.py', 'test/messages/test_convert.py '
         'x_and_y_are_enough_at_the_surface',
         ('heave is measured without z', "'heave' in settings.dofs:", 'False:')),
    *_of('rovid_ros/discovery/candidates.py', 'test/discovery/test_init.py '
         'what_a_controller_wants_is_no_attitude a_boat_has_a_planar_pose '
         'an_accelerometer_is_turned_over_as_its_attitude_says',
         ('what is wanted is measured', 'if not signal.words & (_ASKED | _MADE)]', ']'),
         ('a planar pose has no heading', "rpartition('.')[2] == 'theta'", "path == ''"),
         ('an attitude that is turned over is as good', ' - 2.0 * upside_down(signal)', '')),
    *_of('rovid_ros/discovery/decisions.py', 'test/discovery/test_init.py '
         'a_gps_will_do how_fast_a_boat_turns_is_no_heave '
         'an_accelerometer_is_turned_over_as_its_attitude_says',
         ('the motion says nothing of the frames',
          "if told['ned'] > told['enu'] + EXPLAINED:", 'if False:'),
         ('how fast a boat turns is its heave', '_is_turning(velocities):', 'not velocities:'),
         ('an accelerometer is always upright', '(-1.0 if over else 1.0)', '1.0')),
    *_of('rovid_ros/results/text.py', 'test/commands/test_replay.py '
         'masses_that_are_no_kilograms_are_told',
         ('a command is a newton', 'if not newtons and quantity in _PER_COMMAND:', 'if False:')),
    *_of('rovid_ros/node/health/levels.py', 'test/node/test_diagnostics.py '
         'refused_messages_say_nothing_of_the_clock '
         'commands_that_are_missing_are_the_cause_of_what_is_refused',
         ('what is refused is not looked at first',
          'if share > ACCEPTABLE:  # what', 'if share > 2.0:  # what'),
         ('what commands cause is told for the cause', 'causes = names[::-1]', 'causes = names')),
    *_of('rovid_core/identify/ekf/evidence/innovations.py', 'test/core/test_ekf.py '
         'a_depth_in_steps_that_rests_for_minutes_is_not_taken_to_be_exact',
         ('what never scatters has no noise',
          'if noise >= self.least or factor > 1.0:', 'if True:')),
    *_of('rovid_core/identify/ekf/planar/member.py', 'test/core/test_ekf.py '
         'nor_are_fixes_in_steps',
         ('fixes are exact where they are repeated',
          'max(span.rounding, LEAST_NOISE * self._fastest)',
          'LEAST_NOISE * self._fastest')),
    *_of('rovid_core/identify/ekf/single/measurements.py', 'test/core/test_ekf.py '
         'a_depth_in_steps_that_rests_for_minutes_is_not_taken_to_be_exact',
         ('what is repeated says nothing of rounding',
          'if self._repeats else 0.0', 'if False else 0.0')),
    *_of('rovid_core/identify/ekf/evidence/block_fit.py', 'test/core/test_ekf_honesty.py '
         'a_lag_of_the_thrusters_is_found_and_said',
         ("a lag is always the thrusters'", "if begin + 'lag' in there:", 'if False:')),
    *_of('rovid_core/thrust/force_history.py', 'test/core/test_thrust.py',
         ('a smooth force over seconds is two means', 'if count <= SHORT:', 'if True:'),
         ('an offset comes off behind the direction',
          'offset + math.copysign(abs(u) - offset, s)', 'math.copysign(abs(u), s)')),
    *_of('rovid_core/thrust/thruster_curve.py', 'test/core/test_thrust.py '
         'a_motor_that_turns_the_other_way_has_the_curve_of_its_propeller',
         ('a reversed motor pushes less ahead',
          '-gain * model(twice - raw)', 'gain * model(raw)')),
    *_of('rovid_core/ordering/cadence.py', 'test/core/test_slow_fixes.py '
         'a_gap_is_five_usual_intervals',
         ('a fix that comes again is the next one',
          '0 < time - last <= SHORT and (', 'False and (')),
    *_of('rovid_ros/files/state_file.py', 'test/files/test_state_file.py '
         'what_else_is_looked_for_has_to_be_the_same',
         ('a current fits a state without',
          "'above 0' if settings.estimates_current else '0'", "'0'")),
    *_of('rovid_core/velocity/velocity_source.py', 'test/core/test_pipeline.py '
         'no_fix_is_turned_by_an_attitude_that_nobody_measured',
         ('a lever arm needs no attitude in between',
          'if why or self._lever is None:', 'if self._lever is None:')),
    *_of('rovid_core/pipeline/planar_steps.py', 'test/core/test_pipeline.py '
         'no_fix_is_turned_by_an_attitude_that_nobody_measured',
         ('only the ends of a span have attitudes',
          '            if why:', '            if False:')),
    *_of('rovid_core/trials/score.py', 'test/core/test_score.py '
         'references_of_another_clock_with_the_same_times_are_not_compared',
         ('all clocks are one', 'self._clocks.append(self._references.count)', 'pass')),
    *_of('rovid_core/simulation/sensors.py', 'test/commands/test_simulate.py '
         'magnitudes_and_their_directions_are_those_of_signed_commands',
         ('magnitudes keep their sign', 'offset + abs(u - offset)', 'u')),
    *_of('rovid_core/inputs/units_and_signs.py', 'test/core/test_units_and_signs.py '
         'thrusters_that_push_both_ways_or_not_at_all_need_no_sign',
         ('what nothing pushes goes backwards by thrust',
          'any(map(mul, thrusters.allocation[row], thrusters.gain))', 'True')),
    *_of('rovid_core/identify/ekf/evidence/innovations.py', 'test/core/test_ekf.py '
         'what_is_simulated_without_noise_lacks_nothing',
         ('errors below all noise hang together', 'max(self._square, 1.0)',
          'max(self._square, 1e-300)'),
         ('what has no noise is known to the last digit', 'LEAST_NOISE: Final = 1e-4',
          'LEAST_NOISE: Final = 1e-9')),
    *_of('rovid_core/identify/status.py', 'test/core/test_status.py '
         'what_the_covariance_knows_is_not_said_to_be_hidden',
         ('what is known is said to be hidden', 'self._knows = bool(identifier.covariance) and',
          'self._knows = False and'),
         ('all data are said to hide it', 'if self._knows or self._judgement',
          'if self._judgement')),
    *_of('rovid_core/inputs/configuration_check.py', 'test/core/test_configuration_check.py '
         'one_sinusoid_on_one_axis_accuses_nothing',
         ('a law that fits a little better is right', 'gained.sum() > told.sum() and', '')),
    *_of('rovid_core/inputs/configuration_check.py', 'test/core/test_configuration_check.py '
         'a_vehicle_that_is_driven_ahead_alone_does_not_go_sideways',
         ('an axis that is held counts for nothing', 'row = np.zeros_like(row)', 'continue')),
    *_of('rovid_core/ordering/event_order.py', 'test/core/test_slow_fixes.py '
         'what_a_simulator_stamps_is_said_to_be_of_another_clock',
         ('years are waited for', 'if needed < MOST_WAIT else', 'if needed > 0.0 else')),
    *_of('rovid_ros/discovery/decisions.py', 'test/discovery/test_init.py '
         'a_simulators_stamps_and_the_recorders_time_are_two_clocks '
         'of_two_vehicles_one_is_taken',
         ('all stamps are taken for what they say', 'if not other or', 'if True or'),
         ('two vehicles are one', 'other_vehicles = of_one_vehicle(found)',
          "other_vehicles = found, ''")),
    *_of('rovid_ros/discovery/thrusters.py', 'test/discovery/test_what_drives.py '
         'thrusters_that_are_heard_one_after_the_other_are_driven_together',
         ('a command counts once, however long it holds',
          'held_for = np.diff(times, append=times[-1])', 'held_for = np.ones_like(times)')),
]
