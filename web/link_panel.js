// SPDX-License-Identifier: BSD-3-Clause
/** All numbers of the link, as link_top shows them (doc/monitoring.md). */
import {make} from './dom.js';
import {milliseconds, percent, short, withUnit} from './units.js';

const hertz = (value) => withUnit(value, 1, '');

/** [title, f(stream)] of each column, the most important first: a narrow screen shows some only. */
const COLUMNS = [
  ['Stream', (stream) => stream.stream], ['Shown Hz', (stream) => hertz(stream.shown_hz)],
  ['Age', (stream) => milliseconds(stream.age_median)], ['p99', (stream) => milliseconds(stream.age_p99)],
  ['Loss', (stream) => percent(stream.loss)], ['Quality', (stream) => stream.error || percent(stream.completeness)],
  ['Source Hz', (stream) => hertz(stream.source_hz)], ['Sent Hz', (stream) => hertz(stream.sent_hz)],
  ['kB/s', (stream) => short(stream.bytes_per_second === null ? null : stream.bytes_per_second / 1e3)],
  ['Problem', (stream) => (stream.problems || []).join('; ')]];

const fact = (name, value) => [make('dt', {}, name), make('dd', {}, value)];

function linkFacts({node, link}) {
  if (!link) return fact(node, 'no report of its link');
  return fact(`Link of ${node}`, `${link.state || '-'}: ${short(link.sent_mbit)} of ${short(link.rate_mbit)} Mbit/s sent, ` +
    `${short(link.wanted_mbit)} wanted, ${short(link.capacity_mbit)} carried; queue ${milliseconds(link.queue_delay)}, ` +
    `loss ${percent(link.loss)}, round trip ${milliseconds(link.round_trip)}`);
}

function nodeFacts({node, wifi, transport, clock}) {
  const facts = [];
  if (clock) facts.push(...fact('Clock', `the robot's differs by ${milliseconds(clock.offset)} +- ${milliseconds(clock.uncertainty)}`));
  if (wifi) {
    facts.push(...fact(`Wi-Fi of ${node}`, `${wifi.ssid || wifi.interface}, ${withUnit(wifi.signal_dbm, 0, 'dBm')}, ` +
      `${short(wifi.tx_bitrate_mbit)} Mbit/s out, ${short(wifi.rx_bitrate_mbit)} in`));
  }
  if (transport) {
    facts.push(...fact(`Connection of ${node}`, `${transport.connected_to || '-'}; ` +
      `handshakes: ${short(transport.handshakes)}; dropped: ${short(transport.dropped)}`));
  }
  return facts;
}

/** Paths from this desk to the robot. */
function pathFacts(paths) {
  return (paths || []).flatMap((path) => fact(`Path to ${path.name}`, `${path.address}, ` +
    (path.own_address ? `from ${path.own_address}` : 'no route') + (path.interface ? ` by ${path.interface}` : '') +
    (path.round_trip === null ? '' : `; round trip ${milliseconds(path.round_trip)}`) +
    (path.used ? '' : '; not used')));
}

/**
 * Show a tree of numbers.
 * @param {{facts: HTMLElement, rows: HTMLElement, head: HTMLElement}} places
 * @param {Object} tree as link_top --json prints it
 * @param {Array} paths of the state's link
 */
export function showLink(places, tree, paths) {
  if (!places.head.children.length) {
    places.head.append(make('tr', {}, ...COLUMNS.map(([title]) => make('th', {scope: 'col'}, title))));
  }
  const robots = tree.robots || [], operators = tree.operators || [];
  places.facts.replaceChildren(
    ...robots.flatMap(linkFacts), ...pathFacts(paths), ...[...operators, ...robots].flatMap(nodeFacts));
  places.rows.replaceChildren(...(tree.streams || []).map((stream) =>
    make('tr', {'data-level': stream.level}, ...COLUMNS.map(([, text]) => make('td', {}, text(stream))))));
}
