// SPDX-License-Identifier: BSD-3-Clause
/**
 * What this browser may do: by the token in the address's fragment, or in a form.
 *
 * A fragment is not sent to servers. It is cleared at once: it must not stay in the history, nor be seen by others.
 */
import {byId, make, onPress, setText} from './dom.js';

/** Read a value from the fragment, such as robot in #robot=ugv1. */
export function fragment(name) {
  return new URLSearchParams(location.hash.slice(1)).get(name);
}

/** Write the name of the robot into the fragment: the address can be kept. */
export function setFragment(values) {
  const text = new URLSearchParams(values).toString();
  history.replaceState(null, '', text ? `#${text}` : location.pathname);
}

async function post(path, body) {
  const answer = await fetch(path, {
    method: 'POST', credentials: 'same-origin', headers: {'Content-Type': 'application/json'}, body: JSON.stringify(body)});
  const found = await answer.json().catch(() => ({error: `the desk answers with status ${answer.status}`}));
  if (!answer.ok) throw new Error(found.error || `status ${answer.status}`);
  return found;
}

export class Session {
  /** @param {function} entered f(session), called whenever this browser may see the page */
  constructor(entered) {
    this.entered = entered;
    byId('login-form').addEventListener('submit', (event) => {
      event.preventDefault();
      this.logIn(byId('token').value.trim());
    });
    onPress(byId('log-out'), () => this.logOut());
    onPress(byId('more-rights'), () => this.show(true, 'The token of who drives:'));
    onPress(byId('cancel-login'), () => this.show(false));
  }

  /** Take the token from the fragment, or ask the server who this browser is. */
  async begin() {
    const token = fragment('token');
    if (token) {
      const robot = fragment('robot');
      setFragment(robot ? {robot} : {});
      await this.logIn(token);
    } else {
      await this.look();
    }
  }

  /** Ask the server what this browser may do. */
  async look() {
    try {
      this.take(await (await fetch('/session', {credentials: 'same-origin'})).json());
    } catch {
      // the server does not answer: the banner says so, and the connection is tried again
      this.take({role: 'viewer', driver: false});
    }
  }

  async logIn(token) {
    try {
      const found = await post('/login', {token});
      byId('token').value = '';
      this.take(found);
    } catch (error) {
      this.show(true, '', error.message);
    }
  }

  async logOut() {
    try {
      await post('/logout', {});
    } finally {
      location.reload();
    }
  }

  take(found) {
    const ended = found.role === 'none' && this.role && this.role !== 'none';
    this.role = found.role;
    byId('more-rights').hidden = found.role !== 'viewer' || !found.driver;
    byId('log-out').hidden = !found.token && !found.driver;
    this.show(found.role === 'none', found.token === false ? 'This page is for browsers on the desk itself.' :
      ended ? 'The desk has started anew, or 12 hours have passed. The token of this page:' : '');
    if (found.role !== 'none') this.entered(this);
  }

  /** Show or hide the form. */
  show(wanted, text = '', problem = '') {
    const place = byId('login');
    place.hidden = !wanted;
    byId('cancel-login').hidden = !this.role || this.role === 'none';
    if (!wanted) return;
    setText(byId('login-text'), text || 'The token of this page:');
    byId('login-problem').replaceChildren(...(problem ? [make('strong', {}, problem)] : []));
    byId('token').focus();
  }
}
