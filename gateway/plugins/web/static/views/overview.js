// All starters: those that someone must look at first.

import { get } from "../api.js";
import { KeyedList, h, setClass, setText } from "../dom.js";
import { RANK, SIGNALS, age, fill, number, signalSymbol, sparkline } from "../format.js";
import { carryOut } from "../results.js";
import { store, titleOf } from "../store.js";

const SPARKS_EVERY_MS = 10000;
const HINDRANCES = { configured: "not configured", power_present: "no power", general_enabled: "not enabled", ready_to_start: "not ready to start" }; // by the flag that is false then
const CALM_MS = 1500; // no row moves while someone points at the list, and this long after

/** What is published of one starter, in one object. */
export function summary(name) {
  const state = store.topic(`starter/${name}/state`) ?? {};
  const availability = store.topic(`starter/${name}/availability`) ?? {};
  const facts = store.starters[name] ?? {};
  const alarms = store.below(name, "alarm/").filter(([, alarm]) => alarm.active)
    .map(([code, alarm]) => [code, { ...alarm, acknowledged: facts.acknowledged?.[code] }]);
  const found = {
    name,
    title: titleOf(name),
    state: state.state ?? "unknown",
    isGood: state.quality === "good",
    time: state.time,
    remote: state.remote,
    locked: state.locked,
    availability: availability.state ?? "unknown",
    reason: availability.reason || state.reason || hindrance(state),
    alarms,
    current: store.topic(`starter/${name}/value/current`),
    currentPct: store.topic(`starter/${name}/value/current_pct`),
    facts,
  };
  found.signal = signalOf(found);
  return found;
}

/** Why a motor at rest cannot be started; nothing where it can. */
function hindrance(state) {
  if (state.state !== "not_ready") return "";
  return Object.keys(HINDRANCES).filter((flag) => state[flag] === false).map((flag) => HINDRANCES[flag]).join(", ") || "pausing or being adjusted";
}

function signalOf(starter) {
  const has = (severity) => starter.alarms.some(([, alarm]) => alarm.severity === severity);
  if (starter.state === "fault" || starter.availability === "offline" || has("fault")) return "F";
  if (starter.locked || starter.remote === false || starter.availability === "disabled") return "C";
  if (starter.availability === "degraded" || !starter.isGood || has("alarm")) return "S";
  return starter.alarms.length ? "M" : "";
}

/** The state as a person reads it. */
export function stateWords(starter) {
  const words = starter.state.replaceAll("_", " ");
  return starter.isGood ? words : `${words} (old)`;
}

/** The code of an alarm; nothing where it has none of its own. */
export function alarmName(code, alarm) {
  return code === alarm.severity ? "" : code.toUpperCase();
}

/** The order of starters: abnormal first, and of these the ones that are not acknowledged. */
export function byUrgency(a, b) {
  const isOpen = (starter) => (starter.alarms.some(([, alarm]) => !alarm.acknowledged) ? 0 : 1);
  const isActive = (starter) => (["running", "starting", "stopping"].includes(starter.state) ? 0 : 1);
  return RANK[a.signal] - RANK[b.signal] || isOpen(a) - isOpen(b) || isActive(a) - isActive(b) || a.title.localeCompare(b.title, undefined, { numeric: true });
}

/** What is wrong, or nothing. */
export function trouble(starter) {
  const parts = starter.alarms.map(([code, alarm]) => `${alarmName(code, alarm)} ${alarm.text}${alarm.acknowledged ? ` (acknowledged by ${alarm.acknowledged.by})` : ""}`);
  if (!["online", "unknown"].includes(starter.availability)) parts.unshift(starter.availability + (starter.reason ? `: ${starter.reason}` : ""));
  else if (starter.reason) parts.unshift(starter.reason);
  else if (!starter.isGood) parts.unshift(starter.time ? "not read lately" : "not read yet");
  if (starter.locked) parts.push(`locked by ${starter.locked.by}`);
  return parts.join("; ");
}

/** The current against the rated one, 0 to more than 1; null when it is not known. */
export function loadOf(starter) {
  if (typeof starter.currentPct?.value === "number") return starter.currentPct.value / 100;
  const rated = starter.facts.rated_current_a;
  return rated && typeof starter.current?.value === "number" ? starter.current.value / rated : null;
}

/** More than the rated current is out of specification, but what a start takes is not. */
export function isOverloaded(starter, load) {
  return load > 1 && starter.state === "running";
}

export const COUNTERS = {
  all: () => true,
  running: (starter) => starter.state === "running",
  ready: (starter) => starter.state === "ready",
  starting: (starter) => starter.state === "starting" || starter.state === "stopping",
  fault: (starter) => starter.state === "fault" || starter.alarms.some(([, alarm]) => alarm.severity === "fault"),
  alarm: (starter) => starter.alarms.some(([, alarm]) => alarm.severity !== "fault"),
  offline: (starter) => starter.availability === "offline",
  locked: (starter) => Boolean(starter.locked),
};

class Row {
  constructor(name) {
    this.name = name;
    this.symbol = h("span", { class: "symbol" });
    this.shownSymbol = null;
    this.state = h("span", { class: "state" });
    this.current = h("span", { class: "current" });
    this.bar = h("span", { class: "bar-fill" });
    this.barBox = h("span", { class: "bar-box", "aria-hidden": "true" }, this.bar);
    this.spark = h("span", { class: "spark-box" });
    this.where = h("span", { class: "where" });
    this.trouble = h("span", { class: "trouble" });
    this.age = h("span", { class: "age" });
    this.title = h("span", { class: "name" });
    this.link = h("a", { href: `#/starter/${encodeURIComponent(name)}` },
      this.symbol, this.title, this.state, this.current,
      this.barBox, this.spark, this.where, this.trouble, this.age);
    this.element = h("li", { "data-starter": name }, this.link);
  }

  update(starter) {
    const isRunning = starter.state === "running";
    const symbol = `${starter.signal}${isRunning}`;
    if (symbol !== this.shownSymbol) {
      this.symbol.replaceChildren(signalSymbol(starter.signal, isRunning));
      this.shownSymbol = symbol;
    }
    setText(this.title, starter.title);
    setText(this.state, stateWords(starter));
    setText(this.current, starter.current ? number(starter.current.value, starter.current.unit) : "–");
    setClass(this.current, starter.current?.quality === "good" ? "current" : "current old");
    const load = loadOf(starter);
    setClass(this.barBox, load === null ? "bar-box none" : "bar-box");
    fill(this.bar, load ?? 0);
    setClass(this.bar, isOverloaded(starter, load) ? "bar-fill over" : "bar-fill");
    setText(this.where, starter.remote === undefined ? "" : starter.remote === false ? "local" : "remote");
    setText(this.trouble, trouble(starter));
    setText(this.age, age(store.replyAgeS(this.name)));
    setClass(this.link, `starter signal-${starter.signal || "none"}${starter.isGood ? "" : " old"}`);
  }

  drawSpark(values) {
    this.spark.replaceChildren(sparkline(values));
  }
}

const KINDS = { g: "groups", l: "lines" };

/** What stands above the starters of a group ("g" and its name), of a line ("l" and its name), or of neither. */
function headingOf(key) {
  return KINDS[key[0]] ? titleOf(key.slice(1), KINDS[key[0]]) : key.slice(1);
}

/** The starters of a group or a line; of a group they can be stopped together. */
class Group {
  constructor(key, sparks) {
    const title = headingOf(key);
    this.heading = h("h2", {}, title);
    this.stop = key[0] === "g" ? h("button", { type: "button", class: "stop", "aria-label": `Stop all of ${title}`, onclick: () => carryOut(key.slice(1), "stop") }, "STOP") : null;
    this.why = h("span", { class: "why" });
    this.list = h("ul", { class: "starters" });
    this.element = h("section", { "aria-label": title || "Starters" }, title ? h("div", { class: "group-head" }, this.heading, this.stop, this.why) : null, this.list);
    this.rows = new KeyedList(this.list, (name) => {
      const row = new Row(name);
      row.drawSpark(sparks(name));
      return row;
    });
  }
}

/** How many starters somebody must look at first. */
export function failures() {
  return Object.keys(store.starters).filter((name) => summary(name).signal === "F").length;
}

export class Overview {
  constructor() {
    this.title = "Overview";
    this.filter = "all";
    this.sparks = {};
    this.calmUntil = 0;
    this.buttons = new Map(Object.keys(COUNTERS).map((name) => [name, this.counter(name)]));
    this.search = h("input", { type: "search", placeholder: "Search", "aria-label": "Search starters", oninput: () => this.refresh(true) });
    this.grouping = h("select", { "aria-label": "Group by", onchange: () => {
      localStorage.setItem("grouping", this.grouping.value);
      this.refresh(true);
    } }, ["no groups", "by line", "by group"].map((text) => h("option", { value: text, selected: text === localStorage.getItem("grouping") }, text)));
    this.shape = h("button", { type: "button", class: "plain", "aria-pressed": "false", onclick: () => this.toggleTiles() }, "Tiles");
    this.list = h("div", { class: "groups" });
    for (const event of ["pointermove", "pointerdown", "focusin"]) {
      this.list.addEventListener(event, () => { this.calmUntil = Date.now() + CALM_MS; });
    }
    this.empty = h("p", { class: "empty", hidden: true }, "No starter fits.");
    this.groups = new KeyedList(this.list, (key) => new Group(key, (name) => this.sparks[name] ?? []));
    this.element = h("div", { class: "overview" }, h("h1", { class: "sr" }, "Overview"),
      h("div", { class: "counters", role: "group", "aria-label": "Show only" }, [...this.buttons.values()].map((each) => each.button)),
      h("div", { class: "tools" }, this.search, this.grouping, this.shape), this.list, this.empty);
    this.order = [];
    this.timer = setInterval(() => this.loadSparks(), SPARKS_EVERY_MS);
    this.loadSparks();
  }

  close() {
    clearInterval(this.timer);
  }

  counter(name) {
    const count = h("span", { class: "count" }, "–");
    const button = h("button", { type: "button", class: `counter ${name}`, "aria-pressed": "false", onclick: () => {
      this.filter = this.filter === name ? "all" : name;
      this.refresh(true);
    } }, count, h("span", {}, name));
    return { button, count };
  }

  toggleTiles() {
    const isTiles = this.element.classList.toggle("tiles");
    this.shape.setAttribute("aria-pressed", String(isTiles));
  }

  refresh(isNow = false) {
    const starters = Object.keys(store.starters).map(summary);
    for (const [name, { button, count }] of this.buttons) {
      const found = starters.filter(COUNTERS[name]).length;
      setText(count, store.gen ? String(found) : "–");
      button.setAttribute("aria-pressed", String(this.filter === name));
      button.classList.toggle("some", found > 0);
    }
    const words = this.search.value.trim().toLowerCase();
    const shown = starters.filter((starter) => COUNTERS[this.filter](starter) && fits(starter, words));
    const sorted = this.sorted(shown, isNow);
    const groups = this.grouped(sorted);
    this.groups.update([...groups.keys()]);
    for (const [key, members] of groups) {
      const { rows, heading, stop, why } = this.groups.items.get(key);
      setText(heading, headingOf(key));
      if (stop) {
        // As on a starter's page it stays to be pressed when the page is not live.
        stop.disabled = store.isLive() && !store.session.user;
        setText(why, stop.disabled ? "log in to operate" : "");
      }
      rows.update(members.map((starter) => starter.name));
      for (const starter of members) rows.items.get(starter.name).update(starter);
    }
    this.empty.hidden = shown.length > 0 || !store.gen;
  }

  /** Abnormal first; but while someone points at the list, rows stay where they are. */
  sorted(starters, isNow) {
    const byName = new Map(starters.map((starter) => [starter.name, starter]));
    const isSame = this.order.length === starters.length && this.order.every((name) => byName.has(name));
    if (isNow || !isSame || Date.now() >= this.calmUntil) {
      this.order = [...starters].sort(byUrgency).map((starter) => starter.name);
    }
    return this.order.map((name) => byName.get(name));
  }

  grouped(starters) {
    const kind = this.grouping.value;
    if (kind === "no groups") return new Map([["", starters]]);
    const groups = new Map();
    for (const starter of starters) {
      const keys = kind === "by line" ? [`l${starter.facts.line}`] : starter.facts.groups?.length ? starter.facts.groups.map((name) => `g${name}`) : ["zin no group"]; // the last of all
      for (const key of keys) groups.set(key, [...(groups.get(key) ?? []), starter]);
    }
    return new Map([...groups].sort(([a], [b]) => a.localeCompare(b)));
  }

  async loadSparks() {
    if (document.hidden || this.isLoading) return;
    this.isLoading = true;
    try {
      this.sparks = (await get("api/v1/sparks?points=60")).starters;
      for (const { rows } of this.groups.items.values()) {
        for (const [name, row] of rows.items) row.drawSpark(this.sparks[name] ?? []);
      }
    } catch {
      // The head of the page says that nothing comes.
    } finally {
      this.isLoading = false;
    }
  }
}

function fits(starter, words) {
  if (!words) return true;
  const facts = starter.facts;
  const text = [starter.name, starter.title, starter.state, facts.line, facts.model, facts.kind, ...(facts.groups ?? []), trouble(starter), SIGNALS[starter.signal]].join(" ");
  return words.split(/\s+/).every((word) => text.toLowerCase().includes(word));
}
