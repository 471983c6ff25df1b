// SPDX-License-Identifier: BSD-3-Clause
/** The map with its buttons: zoom, follow, layers, and goals, which are sent by a second touch. */
import {byId, isVisible, make, onPress, setText} from './dom.js';
import {Kind} from './frame.js';
import {MapView} from './map_view.js';

const ZOOM = 1.5;

export class MapPanel {
  /**
   * @param {Connection} connection
   * @param {function} sendGoal f({x, y, yaw}) -> whether it was taken, a promise
   * @param {function} changed called when another area or other layers are shown
   */
  constructor(connection, sendGoal, changed) {
    this.sendGoal = sendGoal;
    this.changed = changed;
    this.robot = null;
    this.choosing = false;      // whether a touch chooses a goal
    this.view = new MapView(
      {canvas: byId('map'), age: byId('map-age'), follow: byId('map-follow')}, connection.clock,
      {goal: (x, y, yaw) => this.takeWish(x, y, yaw), usesGoal: () => this.choosing, moved: changed});
    onPress(byId('map-in'), () => this.zoom(ZOOM));
    onPress(byId('map-out'), () => this.zoom(1 / ZOOM));
    onPress(byId('map-fit'), () => this.view.fit());
    onPress(byId('map-goal'), () => this.choose(!this.choosing));
    onPress(byId('goal-send'), () => this.send());
    onPress(byId('goal-cancel'), () => this.choose(false));
    this.listen(connection);
  }

  listen(connection) {
    const {view} = this;
    const ofRobot = (frame) => this.robot.streams.find((stream) => stream.index === frame.index);
    connection.on('pose', (pose) => view.takePose(pose));
    connection.on('map', (map) => this.takeMap(map));
    connection.on('goal', (goal) => {
      view.goal = goal.x === null ? null : goal;
      view.changed();
    });
    connection.on('path', (path) => {
      view.path = path.points;
      view.changed();
    });
    connection.onFrame(Kind.TILE, (frame) => view.takeTile(frame));
    connection.onFrame(Kind.AGES, (frame) => view.takeAges(frame));
    connection.onFrame(Kind.CLOUD, (frame) => view.takeCloud(frame));
    connection.onFrame(Kind.POINTS, (frame) => {
      const stream = ofRobot(frame);
      if (stream) view.takePoints(stream.name, stream.colour || '#ff5', frame);
    });
    connection.on('open', () => {
      view.tiles.clear();       // the server does not know which were received before
      view.map = null;
    });
  }

  takeMap(map) {
    if (!this.isMap(map.stream)) return;
    this.view.takeMap(map);
  }

  isMap(name) {
    return this.robot && this.mapName === name;
  }

  zoom(factor) {
    this.view.camera.zoom(factor);
    this.view.moved();
  }

  /** Show a robot of `hello`. */
  setRobot(robot, tile) {
    this.robot = robot;
    this.view.clear();
    this.view.tiles.tile = tile;
    this.view.footprint = robot.footprint;
    const of = (kind) => robot.streams.filter((stream) => stream.kind === kind);
    this.maps = of('map');
    this.mapName = (this.maps.find((stream) => stream.primary) || this.maps[0] || {}).name || null;
    this.points = of('points');
    this.clouds = of('cloud');
    this.cloudName = (this.clouds.find((stream) => stream.primary) || this.clouds[0] || {}).name || null;
    this.setLayers();
    this.choose(false);
  }

  /** The menu of layers. */
  setLayers() {
    const shown = this.view.layers = {ages: false, cloud: false, path: true};
    const layers = [['ages', 'Ages of regions: blue old, red older', null], ['path', 'Path driven', '#3fb950']];
    if (this.cloudName) layers.push(['cloud', 'Cloud from above, coloured by height', null]);
    for (const stream of this.points) {
      shown[stream.name] = true;
      layers.push([stream.name, stream.title, stream.colour]);
    }
    byId('layers').replaceChildren(...layers.map(([name, title, colour]) => {
      const box = make('input', {type: 'checkbox', 'data-layer': name, change: () => this.setLayer(name, box.checked)});
      box.checked = shown[name];
      const square = make('i', {class: 'colour', hidden: !colour});
      if (colour) square.style.background = colour;
      return make('label', {}, box, square, title);
    }), ...(this.maps.length > 1 ? [this.mapChoice()] : []));
  }

  mapChoice() {
    const choice = make('select', {'aria-label': 'Map', change: () => {
      this.mapName = choice.value;
      this.view.map = null;
      this.view.tiles.clear();
      this.changed();
    }}, ...this.maps.map((stream) => make('option', {value: stream.name}, stream.title)));
    choice.value = this.mapName;
    return choice;
  }

  setLayer(name, shown) {
    this.view.layers[name] = shown;
    if (name === 'ages' && !shown) this.view.ages = null;
    if (name === 'cloud' && !shown) this.view.cloud = null;
    this.view.changed();
    this.changed();
  }

  /** Begin or end choosing a goal. */
  choose(choosing) {
    this.choosing = choosing;
    this.view.wish = null;
    this.view.changed();
    this.showGoal();
  }

  takeWish(x, y, yaw) {
    const heading = this.view.pose ? Math.atan2(y - this.view.pose.y, x - this.view.pose.x) : 0;
    this.view.wish = {x, y, yaw: yaw ?? heading};
    this.view.changed();
    this.showGoal();
  }

  showGoal() {
    const {wish} = this.view;
    byId('map-goal').setAttribute('aria-pressed', String(this.choosing));
    byId('goal').hidden = !this.choosing;
    byId('goal-send').disabled = !wish;
    setText(byId('goal-text'), wish ? `Goal at ${wish.x.toFixed(1)}, ${wish.y.toFixed(1)} m` :
      'Touch the place, drag to where the robot shall head');
  }

  async send() {
    if (await this.sendGoal(this.view.wish)) this.choose(false);
  }

  /** What is shown, for `watch`. */
  get watched() {
    if (!this.robot || !isVisible(this.view.canvas)) return {};
    const {layers} = this.view;
    return {
      map: this.mapName && {stream: this.mapName, ...this.view.need}, ages: Boolean(this.mapName && layers.ages),
      points: this.points.map((stream) => stream.name).filter((name) => layers[name]).slice(0, 8),
      cloud: layers.cloud ? this.cloudName : null, path: layers.path};
  }

  update() {
    this.view.update();
  }
}
