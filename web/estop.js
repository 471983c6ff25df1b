// SPDX-License-Identifier: BSD-3-Clause
/**
 * The emergency stop: from the moment at which a finger touches it, it is sent until the desk has taken it, also over a
 * connection that is opened again.
 *
 * Releasing it takes two touches at different places: it must be meant.
 */
import {byId, onPress, setText} from './dom.js';
import {noteResult} from './notes.js';

const AGAIN = 300;              // [ms]

export class Estop {
  constructor(connection, requests) {
    this.requests = requests;
    this.pressed = false;       // and not taken yet
    this.engaged = false;
    this.button = byId('estop');
    this.button.addEventListener('pointerdown', (event) => event.button === 0 && this.press());
    this.button.addEventListener('click', (event) => event.detail === 0 && this.press());     // of the keyboard
    onPress(byId('estop-release'), () => this.ask(true));
    onPress(byId('estop-keep'), () => this.ask(false));
    onPress(byId('estop-confirm'), () => this.release());
    connection.on('open', () => this.pressed && this.send());
  }

  /** Engage it. */
  press() {
    this.pressed = true;
    this.ask(false);
    this.send();
    this.show();
  }

  async send() {
    if (!this.pressed || this.sending) return;
    this.sending = true;
    try {
      await this.requests.ask({type: 'estop', engage: true});
      this.pressed = false;
    } catch {
      setTimeout(() => this.send(), AGAIN);
    }
    this.sending = false;
    this.show();
  }

  /** Release it, on purpose. */
  release() {
    this.pressed = false;
    this.ask(false);
    noteResult('Release of the emergency stop', this.requests.ask({type: 'estop', engage: false}));
  }

  /** Show or hide the question whether it shall be released. */
  ask(wanted) {
    byId('estop-question').hidden = !wanted;
    if (wanted) byId('estop-keep').focus();
  }

  /** Take whether it is engaged, as the robot says. */
  take(engaged) {
    this.engaged = engaged;
    if (!engaged) this.ask(false);
    this.show();
  }

  show() {
    document.body.classList.toggle('stopped', this.engaged);
    byId('estop-release').hidden = !this.engaged;
    setText(byId('estop-state'), this.pressed ? 'NOT TAKEN YET' : this.engaged ? 'engaged' : '');
  }
}
