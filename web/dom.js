// SPDX-License-Identifier: BSD-3-Clause
/** Makes and changes elements of the page. Texts are always text, never HTML: they come from the network. */

/** The element with an id. */
export const byId = (id) => document.getElementById(id);

/**
 * A new element.
 * @param {string} tag of HTML
 * @param {Object} attributes a value of false or null leaves the attribute out; functions are listeners
 * @param {...(Node|string)} children
 */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === 'function') element.addEventListener(name, value);
    else if (value !== false && value !== null) element.setAttribute(name, value === true ? '' : value);
  }
  element.append(...children);
  return element;
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
