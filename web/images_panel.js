// SPDX-License-Identifier: BSD-3-Clause
/** All image views of a robot, the primary one first. */
import {Kind} from './frame.js';
import {ImageView} from './image_view.js';
import {isVisible} from './dom.js';

export class ImagesPanel {
  /**
   * @param {HTMLElement} place
   * @param {Connection} connection
   * @param {Object} actions see ImageView
   * @param {function} changed called when other images or sizes are shown
   */
  constructor(place, connection, actions, changed) {
    this.place = place;
    this.connection = connection;
    this.actions = {...actions, enlarge: (name) => this.enlarge(name)};
    this.changed = changed;
    this.views = new Map();     // index of the stream -> view
    this.enlarged = null;
    this.observer = new ResizeObserver(() => changed());
    connection.onFrame(Kind.IMAGE, (frame) => this.views.get(frame.index)?.take(frame));
    connection.on('open', () => this.views.forEach((view) => view.restart()));
  }

  /** Show the images of a robot of `hello`. */
  setRobot(robot) {
    const streams = robot.streams.filter((stream) => stream.kind === 'image');
    streams.sort((a, b) => b.primary - a.primary);
    this.observer.disconnect();
    this.views = new Map(streams.map((stream) =>
      [stream.index, new ImageView(stream, this.connection.clock, this.actions)]));
    this.place.replaceChildren(...[...this.views.values()].map((view) => view.element));
    this.place.dataset.count = streams.length;
    this.views.forEach((view) => this.observer.observe(view.picture));
    this.enlarge(null);
  }

  /** Show one image as large as possible; the one that is so already: all again. */
  enlarge(name) {
    this.enlarged = name === this.enlarged ? null : name;
    for (const view of this.views.values()) {
      const isLarge = view.stream.name === this.enlarged;
      view.element.classList.toggle('enlarged', isLarge);
      view.larger.setAttribute('aria-pressed', String(isLarge));
    }
    document.body.classList.toggle('one-image', this.enlarged !== null);
    this.changed();
  }

  /** What is shown, for `watch`. */
  get watched() {
    return [...this.views.values()].filter((view) => isVisible(view.element) && view.width > 0)
      .slice(0, 8).map((view) => ({stream: view.stream.name, width: view.width, rate: 10}));
  }

  /** Show the ages of now. */
  update() {
    this.views.forEach((view) => view.update());
  }

  titleOf(name) {
    return [...this.views.values()].find((view) => view.stream.name === name)?.stream.title || name;
  }
}
