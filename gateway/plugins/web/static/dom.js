// Elements from data. Every text goes in as text, never as markup.

export function h(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "class") element.className = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

const SVG = "http://www.w3.org/2000/svg";

export function svg(tag, properties = {}, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(properties)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/** Writes a text only when it is another one, so that nothing flickers and screen readers stay quiet. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function setClass(element, name) {
  if (element.className !== name) element.className = name;
}

/** Keeps one child per key, in this order; `make(key)` returns an object with `element`. */
export class KeyedList {
  constructor(parent, make) {
    this.parent = parent;
    this.make = make;
    this.items = new Map();
  }

  update(keys) {
    const wanted = new Set(keys);
    for (const [key, item] of this.items) {
      if (!wanted.has(key)) {
        item.element.remove();
        this.items.delete(key);
      }
    }
    let before = this.parent.firstElementChild;
    for (const key of keys) {
      let item = this.items.get(key);
      if (!item) {
        item = this.make(key);
        this.items.set(key, item);
      }
      if (item.element === before) before = before.nextElementSibling;
      else this.parent.insertBefore(item.element, before);
    }
  }
}

function classOf(cell) {
  if (typeof cell !== "string") return null;
  return /^\d{4}-\d\d-\d\d /.test(cell) ? "time" : cell.length > 24 ? "long" : null;
}

/** A table from rows of cells; a cell is a text, a number or an element. */
export function table(caption, heads, rows) {
  return h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": caption },
    h("table", {},
      h("caption", {}, caption),
      heads.some(Boolean) ? h("thead", {}, h("tr", {}, heads.map((head) => h("th", { scope: "col" }, head)))) : null,
      h("tbody", {}, rows.map((row) => h("tr", {}, row.map((cell) => h("td", { class: classOf(cell) }, cell ?? "")))))));
}
