// A screen that is read from across the room: tiles fill it, what is abnormal comes first.

import { KeyedList, h, setClass, setText } from "../dom.js";
import { clock, number, signalSymbol } from "../format.js";
import { store } from "../store.js";
import { COUNTERS, byUrgency, stateWords, summary, trouble } from "./overview.js";

const LETTERS = 25; // lines of text on the height of the screen at most: read from five times its height
const WIDTH_EM = 9; // of a tile
const HEIGHT_EM = 4.9;

class Tile {
  constructor() {
    this.symbol = h("span", { class: "symbol" });
    this.name = h("span", { class: "name" });
    this.state = h("span", {});
    this.current = h("span", { class: "current" });
    this.trouble = h("span", { class: "trouble" });
    this.element = h("li", {}, h("span", { class: "top" }, this.symbol, this.name), h("span", { class: "top" }, this.state, this.current), this.trouble);
    this.shown = "";
  }

  update(starter) {
    const isRunning = starter.state === "running";
    if (this.shown !== `${starter.signal}${isRunning}`) this.symbol.replaceChildren(signalSymbol(starter.signal, isRunning));
    this.shown = `${starter.signal}${isRunning}`;
    setText(this.name, starter.title);
    setText(this.state, stateWords(starter));
    setText(this.current, starter.current?.quality === "good" ? number(starter.current.value, starter.current.unit) : "");
    setText(this.trouble, trouble(starter));
    setClass(this.element, `tile signal-${starter.signal || "none"}`);
  }
}

export class Wall {
  constructor() {
    this.title = "Wall";
    this.list = h("ul", { class: "tiles-of-wall" });
    this.counts = h("span", {});
    this.element = h("div", { class: "wall-view" }, h("h1", { class: "sr" }, "Wall"), this.list,
      h("p", { class: "wall-foot" }, this.counts, h("a", { href: "#/" }, "Overview")));
    this.tiles = new KeyedList(this.list, () => new Tile());
  }

  close() {}

  refresh() {
    const starters = Object.keys(store.starters).map(summary).sort(byUrgency);
    const [width, height] = [this.list.clientWidth, this.list.clientHeight];
    const least = Math.max(Math.min(window.innerHeight / LETTERS, width / (WIDTH_EM + 0.5)), 14); // px
    const most = Math.max(Math.floor(width / (WIDTH_EM * least)), 1) * Math.max(Math.floor(height / (HEIGHT_EM * least)), 1);
    const shown = starters.slice(0, most);
    // The columns that make the tiles largest.
    let [columns, em] = [1, 0];
    for (let count = 1; count <= shown.length; count += 1) {
      const size = Math.min(width / count / WIDTH_EM, height / Math.ceil(shown.length / count) / HEIGHT_EM);
      if (size > em) [columns, em] = [count, size];
    }
    this.list.style.fontSize = `${Math.floor(em)}px`;
    this.list.style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
    this.tiles.update(shown.map((starter) => starter.name));
    for (const starter of shown) this.tiles.items.get(starter.name).update(starter);
    const counts = Object.entries(COUNTERS).filter(([name]) => name !== "all").map(([name, fits]) => `${starters.filter(fits).length} ${name}`);
    if (shown.length < starters.length) counts.unshift(`and ${starters.length - shown.length} more`);
    setText(this.counts, `${counts.join(" · ")} · ${store.gen ? clock(new Date(store.now()).toISOString()) : ""}`);
  }
}
