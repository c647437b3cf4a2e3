// How busy each line is, and how each starter on it answers.

import { h, table } from "../dom.js";
import { milliseconds, number, percent } from "../format.js";
import { store, titleOf } from "../store.js";

export class Lines {
  constructor() {
    this.title = "Lines";
    this.place = h("div");
    this.element = h("div", {}, h("h1", {}, "Lines"), this.place);
    this.shown = "";
  }

  close() {}

  refresh() {
    const lines = Object.keys(store.lines).map((name) => [name, store.topic(`gateway/line/${name}`)]);
    const shape = JSON.stringify(lines);
    if (shape === this.shown || this.place.contains(document.activeElement)) return;
    this.shown = shape;
    this.place.replaceChildren(...lines.map(([name, line]) => this.line(name, line)));
  }

  line(name, line) {
    const facts = store.lines[name];
    const title = h("h2", {}, titleOf(name, "lines"));
    const where = h("p", { class: "fact" }, `${facts.port}, ${facts.baud} baud, ${facts.framing}`);
    if (!line) return h("section", {}, title, where, h("p", {}, "Nothing is known of it yet."));
    const byAddress = new Map(facts.starters.map((starter) => [String(store.starters[starter]?.address), starter]));
    return h("section", {}, title, where,
      line.is_open === false ? h("p", { class: "wrong" }, "The port is not open.") : null,
      utilisation(line), promises(line), health(line),
      table(`Starters on ${facts.title}`, ["address", "starter", "asked", "answered", "silent", "garbled", "refused", "p50", "p99", "state"],
        Object.entries(line.units ?? {}).map(([unit, counts]) => [unit, starterLink(byAddress.get(unit)), counts.asked, counts.answered, counts.silent,
          counts.garbled, counts.refused, milliseconds(counts.response_time_s?.p50), milliseconds(counts.response_time_s?.p99), counts.state ?? ""])));
  }
}

function starterLink(name) {
  return name ? h("a", { href: `#/starter/${encodeURIComponent(name)}` }, titleOf(name)) : "";
}

function utilisation(line) {
  const part = h("span", { class: "share" });
  part.style.width = `${(line.utilisation ?? 0) * 100}%`;
  return h("div", { class: "share-row" }, h("span", { class: "share-name" }, "utilisation"),
    h("span", { class: "share-box", "aria-hidden": "true" }, part), h("span", {}, percent(line.utilisation)));
}

function promises(line) {
  const computed = line.computed ?? {};
  const latency = line.stop_latency_s ?? {};
  return table("Promised and measured", ["", "computed", "measured"], [
    ["load", percent(computed.load), percent(line.utilisation)],
    ["one round of all polls", number(computed.sweep_s ?? null, "s"), number(line.sweep_s ?? null, "s")],
    ["a stop waits at most", milliseconds(computed.stop_latency_s ?? latency.computed), milliseconds(latency.worst)],
    ["watchdogs' least margin", computed.watchdog_margin_s === null || computed.watchdog_margin_s === undefined ? "none to keep" : number(computed.watchdog_margin_s, "s"), ""],
  ]);
}

function health(line) {
  const words = line.cable?.texts ?? [];
  return words.length ? h("ul", { class: "cable" }, words.map((text) => h("li", {}, text))) : null;
}
