// SPDX-License-Identifier: BSD-3-Clause
/** All robots of the desk, one card each; a touch shows that robot. */
import {make, setData, setText} from './dom.js';
import {duration, percent, short, withUnit} from './units.js';

const TEXTS = {ok: 'OK', warn: 'ATTENTION', error: 'PROBLEM', stale: 'NO DATA'};

function lines(robot) {
  const silent = robot.silence === null || robot.silence > 3;
  return [
    silent ? `NO LINK ${robot.silence === null ? '' : duration(robot.silence)}` :
      `loss ${percent(robot.loss)}, ${short(robot.capacity)} Mbit/s, ${withUnit(robot.signal, 0, 'dBm')}`,
    `battery ${percent(robot.battery)}, ${robot.focus || 'no focus'}`,
    robot.estop ? 'EMERGENCY STOP' : robot.control || '-',
    robot.problems.length ? robot.problems[0] + (robot.problems.length > 1 ? ` (and ${robot.problems.length - 1} more)` : '') : ''];
}

export class Overview {
  /** @param {function} choose f(name of a robot) */
  constructor(place, choose) {
    this.place = place;
    this.choose = choose;
    this.cards = new Map();
  }

  /** @param {Array} robots of `hello` */
  setRobots(robots) {
    this.cards = new Map(robots.map((robot) => [robot.name, make(
      'button', {class: 'card', 'data-level': 'stale', press: () => this.choose(robot.name)},
      make('b', {}, robot.title || robot.name), make('i', {}, TEXTS.stale), ...[0, 1, 2, 3].map(() => make('span')))]));
    this.place.replaceChildren(...this.cards.values());
  }

  /** @param {Array} robots of `overview` */
  show(robots, chosen) {
    for (const robot of robots) {
      const card = this.cards.get(robot.name);
      if (!card) continue;
      setData(card, 'level', robot.level);
      card.setAttribute('aria-pressed', String(robot.name === chosen));
      setText(card.children[1], TEXTS[robot.level] || robot.level);
      lines(robot).forEach((line, index) => setText(card.children[index + 2], line));
    }
  }
}
