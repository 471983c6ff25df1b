// SPDX-License-Identifier: BSD-3-Clause
/**
 * The WebSocket: opened again when it is lost, its messages given to whom they concern, binary frames acknowledged.
 *
 * A frame is acknowledged when it was drawn, or dropped. The server sends no more than a few on trust: a slow browser
 * gets fewer images, not older ones.
 */
import {parse} from './frame.js';
import {monotonic, ServerClock} from './server_clock.js';

const RETRY = 500;              // from one attempt to the next [ms]
const ACKNOWLEDGE = 8;          // acknowledgements of this time go together [ms]
const PING = 1000, FIRST_PINGS = 5, FIRST_PING = 100;   // [ms]
const OPENING = 4000;           // an attempt that takes longer is given up [ms]

export class Connection {
  /** @param {function} refused called where an attempt fails: the session may have ended */
  constructor(refused) {
    this.clock = new ServerClock();
    this.refused = refused;
    this.lastTick = null;       // when the newest came, of monotonic() [s]
    this.tick = null;           // its number
    this.handlers = new Map();
    this.frameHandlers = new Map();
    this.received = {};         // {kind of a frame: {frames, bytes, drawn}}; drawn: when the last was, of monotonic() [s]
    this.socket = null;
    this.wanted = false;
    setInterval(() => this.ping(), PING);
    document.addEventListener('visibilitychange', () => this.ping());
    this.on('tick', (message) => this.takeTick(message));
    this.on('pong', (message) => this.clock.take(message.clock, monotonic(), message.time));
  }

  /** Call handler(message) for each message of a type; 'open' and 'close' are those of the socket. */
  on(type, handler) {
    this.handlers.set(type, [...this.handlers.get(type) || [], handler]);
  }

  /** Call handler(frame) for each binary frame of a kind. The promise that it returns ends when the frame was drawn. */
  onFrame(kind, handler) {
    this.frameHandlers.set(kind, handler);
  }

  get isOpen() {
    return this.socket !== null && this.socket.readyState === WebSocket.OPEN;
  }

  /** Send a message; returns whether there is a connection. */
  send(message) {
    if (!this.isOpen) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  /** Connect, and again whenever the connection is lost. */
  open() {
    this.wanted = true;
    if (this.socket) return;
    const socket = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/ws`);
    this.socket = socket;
    this.pending = [];
    const giveUp = setTimeout(() => socket.close(), OPENING);
    let wasOpen = false;
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      wasOpen = true;
      clearTimeout(giveUp);
      for (let number = 0; number < FIRST_PINGS; number++) setTimeout(() => this.ping(), number * FIRST_PING);
      this.tell({type: 'open'});
    };
    socket.onmessage = (event) => {
      if (socket !== this.socket) return;
      if (typeof event.data === 'string') this.tell(JSON.parse(event.data));
      else this.takeFrame(socket, event.data);
    };
    socket.onclose = () => {
      clearTimeout(giveUp);
      this.socket = null;
      this.tell({type: 'close'});
      if (!wasOpen && this.wanted) this.refused();
      setTimeout(() => this.wanted && this.open(), RETRY);
    };
  }

  /** Disconnect, and stay so. */
  close() {
    this.wanted = false;
    if (this.socket) this.socket.close();
  }

  tell(message) {
    for (const handler of this.handlers.get(message.type) || []) handler(message);
  }

  takeTick(message) {
    const now = monotonic();
    this.clock.atLeast(message.time, now);
    this.tick = message.n;
    this.roundTrip = message.roundtrip;
    // one that waited in the network is as old as it is
    this.lastTick = now - Math.max(0, this.clock.now() - message.time);
  }

  ping() {
    if (!document.hidden) this.send({type: 'ping', id: 0, clock: monotonic()});
  }

  async takeFrame(socket, buffer) {
    const frame = parse(buffer);
    const entry = {number: frame.number, drawn: false};
    const received = this.received[frame.kind] ??= {frames: 0, bytes: 0, drawn: null};
    received.frames++;
    received.bytes += buffer.byteLength;
    this.pending.push(entry);
    try {
      const handler = this.frameHandlers.get(frame.kind);
      if (handler) await handler(frame);
    } catch (error) {
      console.warn(`a frame of kind ${frame.kind} cannot be drawn: ${error}`);
    } finally {
      entry.drawn = true;
      received.drawn = monotonic();
      if (socket === this.socket && !this.acknowledging) {
        this.acknowledging = setTimeout(() => this.acknowledge(), ACKNOWLEDGE);
      }
    }
  }

  /** Say up to which frame all were drawn. */
  acknowledge() {
    this.acknowledging = null;
    let last = null;
    while (this.pending.length && this.pending[0].drawn) last = this.pending.shift().number;
    if (last !== null) this.send({type: 'shown', number: last});
  }
}
