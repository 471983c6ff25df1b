// SPDX-License-Identifier: BSD-3-Clause
/** All that commands the robot: control, stick and keys, speed, focus, emergency stop. */
import {byId, make, onPress, setData, setText} from './dom.js';
import {Driving} from './driving.js';
import {DrivingKeys} from './driving_keys.js';
import {Estop} from './estop.js';
import {noteResult} from './notes.js';
import {isFree} from './status_tiles.js';
import {Stick} from './stick.js';
import {milliseconds} from './units.js';

export class DrivePanel {
  constructor(connection, requests) {
    this.connection = connection;
    this.requests = requests;
    this.role = 'viewer';
    this.robot = this.state = null;
    this.estop = new Estop(connection, requests);
    this.driving = new Driving(connection, (wish) => this.stick.show(wish));
    this.stick = new Stick(byId('stick'), byId('knob'), this.driving);
    this.keys = new DrivingKeys(byId('stick'), this.driving, {
      estop: () => this.estop.press(), take: () => this.control('take'), release: () => this.control('release')});
    onPress(byId('take'), () => this.control('take'));
    onPress(byId('give'), () => this.control('release'));
    onPress(byId('strafe'), (event) => this.setSideways(event.currentTarget));
    byId('focus').addEventListener('change', (event) => this.setFocus(event.currentTarget.value));
    for (const button of document.querySelectorAll('[data-share]')) {
      onPress(button, () => this.setShare(button));
    }
  }

  setRobot(robot) {
    this.robot = robot;
    this.state = null;
    byId('strafe').hidden = !robot.strafe;
    this.update();
  }

  /** Take a `state`. */
  take(state) {
    this.state = state;
    this.estop.take(state.estop);
    this.showFocus(state);
    this.update();
  }

  setShare(chosen) {
    this.driving.share = Number(chosen.dataset.share);
    for (const button of document.querySelectorAll('[data-share]')) {
      button.setAttribute('aria-pressed', String(button === chosen));
    }
  }

  setSideways(button) {
    this.stick.sideways = !this.stick.sideways;
    button.setAttribute('aria-pressed', String(this.stick.sideways));
  }

  async control(wish) {
    this.driving.stop();
    await noteResult(wish === 'take' ? 'Take control' : 'Release control', this.requests.ask({type: 'control', wish}));
    this.connection.send({type: 'halt'});       // the stick is at rest: nothing has to wait for that
  }

  async setFocus(focus) {
    await noteResult(`Focus ${focus}`, this.requests.ask({type: 'focus', focus}));
    this.focusShown = null;     // what the robot has is shown again, if it was refused
  }

  showFocus({focus, profiles}) {
    const key = JSON.stringify([focus, profiles]);
    if (key === this.focusShown || document.activeElement === byId('focus')) return;
    this.focusShown = key;
    const names = profiles.includes(focus) || !focus ? profiles : [focus, ...profiles];
    byId('focus').replaceChildren(...names.map((name) => make('option', {value: name}, name)));
    byId('focus').value = focus;
    byId('focus').disabled = !profiles.length;
  }

  /** Why this browser may not drive now; empty: it may. */
  get obstacle() {
    const {robot, state} = this;
    if (this.role !== 'driver') return "Driving needs the driver's token";
    if (!robot || !state) return 'No state of the robot yet';
    if (!robot.drives) return 'There is no stream of commands';
    if (document.body.classList.contains('stale')) return 'No connection';
    if (state.estop) return 'EMERGENCY STOP';
    if (state.browser === 'other') return 'Another browser drives';
    if (!state.mine) return state.driver ? `${state.driver} drives` : 'Nobody drives: take control';
    if (state.browser !== 'this') return 'Take control to drive here';
    return '';
  }

  /** Show who drives, and what is allowed now. */
  update() {
    const {obstacle} = this;
    this.driving.allow(obstacle === '');
    setData(byId('stick'), 'allowed', String(obstacle === ''));
    const locked = obstacle === '' && !isFree(this.state) ? this.state.control : '';
    setText(byId('stick-text'), obstacle || locked);
    byId('take').hidden = Boolean(this.state && this.state.mine && this.state.browser === 'this');
    byId('give').hidden = !byId('take').hidden;
    setText(byId('page-latency'), milliseconds(this.connection.roundTrip ?? this.connection.clock.roundTrip));
    const link = this.state && this.state.link;
    setText(byId('robot-latency'), milliseconds(link ? link.round_trip : null));
  }
}
