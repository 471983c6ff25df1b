// SPDX-License-Identifier: BSD-3-Clause
/**
 * The map with all that is known of places: drawn when something of it has changed.
 *
 * Scans, cloud and robot are drawn only while they are of now; the robot's last place stays, in grey, with its age.
 */
import {onPress, setText} from './dom.js';
import {decode} from './frame.js';
import {MapCamera} from './map_camera.js';
import {AGE_COLOURS, drawGoal, drawMeasure, drawPath, drawPoints, drawRaster, drawRobot} from './map_layers.js';
import {extent, levelFor, roundOutwards} from './map_place.js';
import {coloured, MapTiles} from './map_tiles.js';
import {MapTouch} from './map_touch.js';
import {duration} from './units.js';

const POINTS_LAST = 3, CLOUD_LASTS = 5, POSE_LASTS = 1;    // ages up to which they count as of now [s]
const VIRTUAL_SCAN_POINT = 0.1;

export class MapView {
  /**
   * @param {{canvas, age, follow}} elements
   * @param {ServerClock} clock
   * @param {{goal, usesGoal, moved}} actions see MapTouch; moved: another area is shown
   */
  constructor(elements, clock, actions) {
    Object.assign(this, elements);
    this.clock = clock;
    this.actions = actions;
    this.camera = new MapCamera();
    this.touch = new MapTouch(this.canvas, this.camera, {
      changed: () => this.moved(), goal: actions.goal, usesGoal: actions.usesGoal});
    onPress(this.follow, () => this.followRobot());
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    this.tiles = new MapTiles(128, () => this.changed());
    this.layers = {};           // {name of a layer: whether it is shown}
    this.clear();
  }

  /** Forget everything, as for another robot. */
  clear() {
    this.map = this.pose = this.goal = this.wish = this.cloud = this.ages = null;
    this.path = [];
    this.points = new Map();    // stream -> {points, colour, until}
    this.tiles.clear();
    this.footprint = null;
    this.changed();
  }

  /** Draw soon. */
  changed() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
    });
  }

  moved() {
    this.follow.setAttribute('aria-pressed', String(this.camera.follows));
    this.changed();
    this.actions.moved();
  }

  resize() {
    const box = this.canvas.getBoundingClientRect();
    if (!box.width) return;
    [this.camera.width, this.camera.height] = [box.width, box.height];
    this.camera.mark = parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;
    this.canvas.width = Math.round(box.width * devicePixelRatio);
    this.canvas.height = Math.round(box.height * devicePixelRatio);
    this.moved();
  }

  followRobot() {
    this.camera.follows = true;
    this.takePose(this.pose);
    this.moved();
  }

  /** Show the whole map. */
  fit() {
    if (this.map) this.camera.fit(extent(this.map));
    this.moved();
  }

  takeMap(map) {
    if (!this.map || this.map.id !== map.id) this.tiles.clear();
    this.map = map;
    this.moved();
  }

  takePose(pose) {
    if (!pose || pose.x === null) {
      if (this.pose && pose) this.pose.until = -Infinity;
      return;
    }
    this.pose = pose;
    pose.until ??= this.clock.now() + POSE_LASTS - pose.age;
    if (this.camera.follows) {
      [this.camera.x, this.camera.y] = [pose.x, pose.y];
      this.actions.moved();
    }
    this.changed();
  }

  async takeTile(frame) {
    if (this.map && frame.meta.id === this.map.id) await this.tiles.take(frame);
  }

  async takeAges(frame) {
    this.ages = {raster: await coloured(frame.data, AGE_COLOURS), place: frame.meta};
    this.changed();
  }

  async takeCloud(frame) {
    const raster = frame.data.length ? await decode(frame.data, 'image/png') : null;
    this.cloud = raster && {raster, place: frame.meta, until: this.clock.now() + CLOUD_LASTS - frame.meta.age};
    this.changed();
  }

  takePoints(name, colour, frame) {
    const points = new Float32Array(frame.data.slice().buffer);
    this.points.set(name, {points, colour, until: this.clock.now() + POINTS_LAST - frame.meta.age});
    this.changed();
  }

  get level() {
    return levelFor(this.camera.scale * devicePixelRatio, this.map ? this.map.resolution : undefined);
  }

  /** What of the map is needed: {level, area}. */
  get need() {
    const cells = (this.tiles.tile << this.level) * (this.map ? this.map.resolution : 0.05);
    return {level: this.level, area: roundOutwards(this.camera.area, cells)};
  }

  draw() {
    const {camera, canvas} = this, now = this.clock.now();
    const context = canvas.getContext('2d', {alpha: false});
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    context.imageSmoothingEnabled = false;
    context.fillStyle = '#1b1f24';
    context.fillRect(0, 0, camera.width, camera.height);
    if (this.map) this.drawTiles(context);
    if (this.ages && this.layers.ages) drawRaster(context, camera, this.ages.raster, this.ages.place);
    if (this.cloud && this.layers.cloud && now < this.cloud.until) {
      drawRaster(context, camera, this.cloud.raster, this.cloud.place);
    }
    if (this.layers.path) drawPath(context, camera, this.path);
    for (const [name, {points, colour, until}] of this.points) {
      if (this.layers[name] && now < until) drawPoints(context, camera, points, colour, VIRTUAL_SCAN_POINT);
    }
    if (this.goal) drawGoal(context, camera, this.goal, true);
    if (this.pose) drawRobot(context, camera, this.pose, this.footprint, now < this.pose.until);
    if (this.wish) drawGoal(context, camera, this.wish, false);
    drawMeasure(context, camera);
    this.drawn = this.ofNow(now);
    this.canvas.dataset.tiles = this.tiles.tiles.size;
  }

  drawTiles(context) {
    const {camera, map} = this;
    const [left, top] = camera.toScreen(map.x, map.y);
    const scale = map.resolution * camera.scale;
    context.save();
    context.translate(left, top);
    context.rotate(-map.yaw);
    context.scale(scale, -scale);
    this.tiles.draw(context, map, this.level, camera.area, 0.6 / scale);
    context.restore();
  }

  /** Show what has become old; call it often. */
  update() {
    const now = this.clock.now();
    let text = 'The place of the robot is not known yet';
    if (!this.map) text = 'No map yet';
    else if (this.pose) text = now < this.pose.until ? '' : `ROBOT'S PLACE: ${duration(now - this.pose.until + POSE_LASTS)} OLD`;
    setText(this.age, text);
    if (this.ofNow(now) !== this.drawn) this.changed();
  }

  /** What counts as of now, as a text: where it differs from what was drawn, something has become old. */
  ofNow(now) {
    const all = [this.pose, this.cloud, ...this.points.values()];
    return all.map((one) => Number(Boolean(one) && now < one.until)).join('');
  }
}
