// SPDX-License-Identifier: BSD-3-Clause
/** Makes and changes elements of the page. Texts are always text, never HTML: they come from the network. */

/** The element with an id. */
export const byId = (id) => document.getElementById(id);

/**
 * A new element.
 * @param {string} tag of HTML
 * @param {Object} attributes a value of false or null leaves the attribute out; functions are listeners, see onPress
 * @param {...(Node|string)} children
 */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === 'press') onPress(element, value);
    else if (typeof value === 'function') element.addEventListener(name, value);
    else if (value !== false && value !== null) element.setAttribute(name, value === true ? '' : value);
  }
  element.append(...children);
  return element;
}

const LONG = 350, CLICK_FOLLOWS = 700;      // of a touch, and of the click after one [ms]

/**
 * Call f(event) when an element was pressed: by a finger, however long it stays, the mouse, or the keyboard.
 *
 * Browsers make no click of a long touch, but fingers in gloves touch long.
 */
export function onPress(element, f) {
  let down = null, pressed = -Infinity;
  element.addEventListener('pointerdown', (event) => {
    down = event;
  });
  element.addEventListener('pointercancel', () => {
    down = null;
  });
  element.addEventListener('pointerup', (event) => {
    const box = element.getBoundingClientRect();
    const inside = event.clientX >= box.left && event.clientX <= box.right &&
      event.clientY >= box.top && event.clientY <= box.bottom;
    const isLong = down && down.pointerId === event.pointerId && event.timeStamp - down.timeStamp > LONG;
    if (!isLong || !inside || event.button > 0 || element.disabled) return;
    pressed = event.timeStamp;
    f(event);
  });
  element.addEventListener('click', (event) => event.timeStamp - pressed > CLICK_FOLLOWS && f(event));
  element.addEventListener('contextmenu', (event) => event.preventDefault());
}

/** Set a text, if it differs: an equal one would be laid out again. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Set a data attribute, if it differs. */
export function setData(element, name, value) {
  if (element.dataset[name] !== value) element.dataset[name] = value;
}

/** Whether an element is laid out, so that it can be seen. */
export const isVisible = (element) => element.getClientRects().length > 0;
