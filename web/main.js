// SPDX-License-Identifier: BSD-3-Clause
/** The commander's page: joins its parts. The server and its protocol are described in doc/web_protocol.md. */
import {Connection} from './connection.js';
import {byId, onPress, setText} from './dom.js';
import {DrivePanel} from './drive_panel.js';
import {addStill, showCaptures} from './files_panel.js';
import {ImagesPanel} from './images_panel.js';
import {showLink} from './link_panel.js';
import {LogPanel} from './log_panel.js';
import {MapPanel} from './map_panel.js';
import {measured} from './measured.js';
import {note, noteResult} from './notes.js';
import {Overview} from './overview.js';
import {Requests} from './requests.js';
import {fragment, Session, setFragment} from './session.js';
import {monotonic} from './server_clock.js';
import {watchSilence} from './staleness.js';
import {StatusTiles, tilesOf} from './status_tiles.js';
import {Tabs} from './tabs.js';
import {Watch} from './watch.js';

const LOOK = 100;               // ages are shown anew after this time [ms]
const STATE_LASTS = 3;          // [s]
const TABS = {robots: 'Robots', images: 'Images', map: 'Map', drive: 'Drive', status: 'Status', log: 'Log', files: 'Files'};

class Page {
  constructor() {
    this.robots = [];
    this.robot = null;
    this.stateCame = -Infinity;
    this.connection = new Connection(() => this.session.look());
    this.requests = new Requests(this.connection);
    this.session = new Session((session) => this.enter(session.role));
    this.makePanels();
    this.listen();
    watchSilence(this.connection);
    setInterval(() => this.update(), LOOK);
    this.session.begin();
  }

  makePanels() {
    const {connection, requests} = this;
    const changed = () => this.watch && this.watch.changed();
    this.images = new ImagesPanel(byId('images'), connection, {
      still: (stream) => this.still(stream), capture: (stream) => this.capture(stream),
      value: (stream, x, y) => requests.ask({type: 'value', stream, x, y})}, changed);
    this.map = new MapPanel(connection, (goal) => noteResult('Goal', requests.ask({type: 'goal', ...goal})), changed);
    this.drive = new DrivePanel(connection, requests);
    this.log = new LogPanel(byId('log'), byId('log-level'));
    this.tiles = new StatusTiles(byId('tiles'));
    this.overview = new Overview(byId('robots'), (name) => this.choose(name));
    this.watch = new Watch(connection, () => this.shown());
    this.tabs = new Tabs(TABS, (name) => this.showTab(name));
    this.tabs.choose('images');
  }

  listen() {
    const {connection} = this;
    connection.on('hello', (hello) => this.takeHello(hello));
    connection.on('role', ({role}) => this.setRole(role));
    connection.on('state', (state) => this.takeState(state));
    connection.on('overview', ({robots}) => this.overview.show(robots, this.robot && this.robot.name));
    connection.on('log', ({entries}) => this.log.add(entries));
    connection.on('link', ({tree}) => showLink(
      {facts: byId('link-facts'), head: byId('link-head'), rows: byId('link-rows')}, tree, this.paths));
    connection.on('progress', (progress) => setText(
      byId('progress'), `${progress.stream}: ${progress.state}, ${Math.round(progress.progress * 100)} %`));
    connection.on('error', (error) => error.id === undefined && note(error.text, true));
    onPress(byId('captures-again'), () => this.listCaptures());
  }

  /** This browser may see the page. */
  enter(role) {
    this.setRole(role);
    this.connection.open();
  }

  setRole(role) {
    document.body.dataset.role = role;
    this.drive.role = role;
    this.drive.update();
  }

  takeHello(hello) {
    this.setRole(hello.role);
    this.tile = hello.tile;
    this.log.clear();
    const isSame = JSON.stringify(hello.robots) === JSON.stringify(this.robots);
    this.robots = hello.robots;
    if (isSame && this.robot) return;
    this.drive.driving.stop();
    this.robot = null;
    document.body.classList.remove('robot-chosen');     // it may have another name now, or be gone
    this.overview.setRobots(hello.robots);
    document.body.classList.toggle('many-robots', hello.robots.length > 1);
    this.tabs.offer('robots', hello.robots.length > 1);
    const wanted = fragment('robot');
    if (hello.robots.length === 1) this.choose(hello.robots[0].name);
    else if (hello.robots.some((robot) => robot.name === wanted)) this.choose(wanted);
    else this.tabs.choose('robots');
  }

  /** Show a robot. */
  choose(name) {
    const robot = this.robots.find((one) => one.name === name);
    if (this.tabs.chosen === 'robots') this.tabs.choose('images');
    if (this.robot && this.robot.name === name) return;
    this.drive.driving.stop();
    this.robot = robot;
    setText(byId('title'), robot.title || robot.name || 'robot');
    document.title = `${robot.title || robot.name || 'robot'} - smokebot`;
    if (this.robots.length > 1) setFragment({robot: name});
    this.images.setRobot(robot);
    this.map.setRobot(robot, this.tile);
    this.drive.setRobot(robot);
    this.log.clear();
    document.body.classList.add('robot-chosen');
    document.body.classList.toggle('takes-goals', robot.goals);
    this.watch.changed();
  }

  takeState(state) {
    this.stateCame = monotonic();
    this.paths = state.link && state.link.paths;
    this.tiles.show(tilesOf(state));
    this.drive.take(state);
    byId('problems').replaceChildren(...state.problems.slice(0, 5).map((problem) => {
      const line = document.createElement('li');
      setText(line, problem);
      return line;
    }));
    document.body.classList.toggle('robot-silent', state.silence === null || state.silence > STATE_LASTS);
  }

  showTab(name) {
    if (name === 'files' && this.robot) this.listCaptures();
    this.watch.changed();
  }

  async still(stream) {
    const answer = await noteResult('Still', this.requests.ask({type: 'still', stream}));
    if (answer) addStill(byId('stills'), this.images.titleOf(stream), answer);
  }

  async capture(stream) {
    await noteResult('Original', this.requests.ask({type: 'capture', stream}));
    this.listCaptures();
  }

  async listCaptures() {
    try {
      showCaptures(byId('captures'), (await this.requests.ask({type: 'captures'})).files);
    } catch (error) {
      note(`Captures: ${error.message}`, true);
    }
  }

  /** What this browser shows, for `watch`. */
  shown() {
    const robot = this.robot ? this.robot.name : null;
    if (document.hidden || !this.robot) return {type: 'watch', robot};
    const {chosen} = this.tabs;
    return {
      type: 'watch', robot, images: this.images.watched, ...this.map.watched, log: chosen === 'log', link: chosen === 'status'};
  }

  update() {
    if (document.hidden) return;
    this.images.update();
    this.map.update();
    this.drive.update();
    if (monotonic() - this.stateCame > STATE_LASTS) document.body.classList.add('robot-silent');
  }
}

window.smokebot = {measured, page: new Page()};
