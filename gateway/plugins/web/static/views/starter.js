// One starter: what it is, what it reports, what may be done with it.

import { get, post } from "../api.js";
import { h, setClass, setText, table } from "../dom.js";
import { SIGNALS, actionWords, age, clock, dateTime, fill, number, signalSymbol, words } from "../format.js";
import { connect, store, titleOf } from "../store.js";
import { notice } from "../results.js";
import { Faceplate } from "./faceplate.js";
import { History } from "./history.js";
import { alarmName, isOverloaded, loadOf, stateWords, summary, trouble } from "./overview.js";
import { Parameters } from "./parameters.js";

const FACTS = { name: "name", family: "family", kind: "kind", model: "model", firmware: "firmware", serial: "serial number", hardware: "hardware", rated_current_a: "rated current, A", line: "line", address: "address", slot: "slot", accessories: "accessories" };

export class Starter {
  constructor(name) {
    this.name = name;
    this.title = name;
    this.symbol = h("span", { class: "symbol large" });
    this.state = h("p", { class: "big-state" });
    this.trouble = h("p", { class: "trouble", role: "status" });
    this.alarms = h("div", { class: "alarms" });
    this.alarmsShown = "";
    this.heading = h("h1", {}, titleOf(name));
    this.named = h("span", { class: "hint" });
    this.current = h("p", { class: "big-current" });
    this.bar = h("span", { class: "bar-fill" });
    this.barBox = h("span", { class: "bar-box wide", "aria-hidden": "true" }, this.bar);
    this.more = h("p", { class: "fact" });
    this.faceplate = new Faceplate(name);
    this.points = h("div");
    this.facts = h("div");
    this.commands = h("div");
    this.history = new History(name);
    this.parameters = new Parameters(name);
    this.element = h("div", { class: "one-starter" },
      h("div", { class: "head" }, this.symbol, this.heading, this.named, this.state),
      h("div", { class: "columns" },
        h("section", { "aria-label": "State" }, this.trouble, this.alarms, this.current,
          this.barBox, this.more), this.faceplate.element, this.history.now),
      this.history.element,
      h("section", {}, h("h2", {}, "Values"), this.points),
      h("section", {}, h("h2", {}, "Last commands"), this.commands),
      h("section", {}, h("h2", {}, "Identity"), this.facts),
      this.parameters.element, this.faceplate.stopPlace);
    this.detail = null;
    connect(name);
    this.load();
    this.timer = setInterval(() => this.drawPoints(), 1000);
  }

  close() {
    clearInterval(this.timer);
    this.faceplate.close();
    this.history.close();
    connect(null);
  }

  refresh(_isNow, changed, messages = []) {
    const starter = summary(this.name);
    if (!store.starters[this.name] && store.gen) {
      setText(this.trouble, `There is no starter ${this.name} in this gateway's configuration.`);
      this.symbol.replaceChildren();
      for (const place of [this.state, this.current, this.more]) setText(place, "");
      fill(this.bar, 0);
      this.points.replaceChildren();
      this.faceplate.refresh();
      return;
    }
    this.title = starter.title;
    setText(this.heading, starter.title);
    setText(this.named, starter.title === this.name ? "" : this.name);
    this.drawAlarms(starter);
    this.symbol.replaceChildren(signalSymbol(starter.signal, starter.state === "running"));
    setText(this.state, stateWords(starter));
    setText(this.trouble, trouble({ ...starter, alarms: [] }) || (starter.alarms.length ? "" : SIGNALS[starter.signal]));
    setText(this.current, starter.current ? number(starter.current.value, starter.current.unit) : "no current known");
    setClass(this.current, starter.current?.quality === "good" ? "big-current" : "big-current old");
    const load = loadOf(starter);
    this.barBox.hidden = load === null;
    fill(this.bar, load ?? 0);
    setClass(this.bar, isOverloaded(starter, load) ? "bar-fill over" : "bar-fill");
    const parts = [starter.remote === false ? "local" : starter.remote ? "remote" : "", load === null ? "" : `${Math.round(load * 100)} % of rated`,
      store.replyAgeS(this.name) === null ? "it has not answered yet" : `last reply ${age(store.replyAgeS(this.name))} ago`];
    setText(this.more, parts.filter(Boolean).join(" · "));
    this.faceplate.refresh();
    if (!changed || [...changed].some((topic) => topic.startsWith(`starter/${this.name}/value/`))) this.drawPoints();
    if (messages.some(({ topic }) => topic.startsWith(`result/${this.name}/`))) this.load();
    if (messages.some(({ topic }) => topic === `starter/${this.name}/start` || topic === `starter/${this.name}/trip`)) this.history.load();
  }

  /** The alarms that are active, each to be acknowledged: seen and taken on, not reset. */
  drawAlarms({ alarms }) {
    const isOpen = Boolean(store.session.user);
    const shape = JSON.stringify([alarms, isOpen]);
    if (shape === this.alarmsShown) return;
    this.alarmsShown = shape;
    this.alarms.replaceChildren(...alarms.map(([code, alarm]) => h("div", { class: "action" },
      h("span", {}, `${alarmName(code, alarm)} ${alarm.text}, since ${dateTime(alarm.time)}`),
      alarm.acknowledged ? h("span", { class: "why" }, `acknowledged by ${alarm.acknowledged.by}, ${dateTime(alarm.acknowledged.time)}`)
        : [h("button", { type: "button", disabled: !isOpen, onclick: () => acknowledge(this.name, code) }, `Acknowledge ${alarmName(code, alarm)}`),
          h("span", { class: "why" }, isOpen ? "" : "log in to acknowledge")])));
  }

  async load() {
    try {
      this.detail = await get(`api/v1/starter/${encodeURIComponent(this.name)}`);
    } catch (error) {
      this.facts.replaceChildren(h("p", { class: "wrong" }, error.message));
      if (error.code === "not_found") {
        setText(this.trouble, `There is no starter ${this.name} in this gateway's configuration.`);
        connect(null); // of what is not there, there is no stream
      }
      return;
    }
    const info = this.detail.topics?.[`starter/${this.name}/info`] ?? {};
    const facts = { name: this.name, ...this.detail.facts, ...Object.fromEntries(Object.entries(info).filter(([, value]) => value !== null)) };
    this.facts.replaceChildren(h("dl", {}, Object.entries(FACTS).filter(([key]) => facts[key] !== undefined && facts[key] !== null)
      .map(([key, title]) => [h("dt", {}, title), h("dd", {}, Array.isArray(facts[key]) ? facts[key].join(", ") : String(facts[key]))])));
    const commands = [...(this.detail.commands ?? [])].reverse();
    this.history.mark(commands);
    this.commands.replaceChildren(commands.length ? table("Last commands, newest first", ["time", "by", "command", "phases", "text"], commands.map(commandRow)) : h("p", {}, "None since the gateway started."));
    this.drawPoints();
  }

  drawPoints() {
    const values = store.below(this.name, "value/");
    const info = store.topic(`starter/${this.name}/info`)?.points ?? {};
    const places = new Map(Object.keys(info).map((point, index) => [point, index]));
    const place = ([point, value]) => (typeof value.value === "boolean" ? 1e6 : 0) + (places.get(point) ?? 1e5); // numbers, then flags
    const rows = values.sort((a, b) => place(a) - place(b)).map(([point, value]) => [
      pointName(point, info[point]),
      value.label ?? number(value.value, value.unit),
      h("span", { class: value.quality === "good" ? "" : "old", title: value.reason ?? "" }, value.quality),
      value.time ? `${age(store.ageS(value.time))} ago` : "never",
    ]);
    if (this.points.contains(document.activeElement) && this.pointCount === rows.length) {
      const cells = this.points.querySelectorAll("tbody tr");
      rows.forEach((row, index) => row.forEach((cell, at) => at && setText(cells[index].children[at], cell.textContent ?? String(cell))));
      return;
    }
    this.pointCount = rows.length;
    this.points.replaceChildren(table("Values", ["point", "value", "quality", "reported"], rows));
  }
}

async function acknowledge(name, code) {
  try {
    await post(`api/v1/acknowledge/${encodeURIComponent(name)}/${encodeURIComponent(code)}`);
  } catch (error) {
    notice(`acknowledge ${titleOf(name)}`, error.message);
  }
}

function pointName(point, about) {
  const name = about?.name ?? "";
  return h("span", { title: about?.meaning ?? "" }, name || point, name ? h("span", { class: "hint" }, ` ${point}`) : null);
}

/** A command as a person writes it; a selection names the one that it is for. */
function commandWords({ verb, args = {} }) {
  if (verb === "select") return `select ${commandWords({ verb: args.verb ?? "", args: args.args })}`;
  if (Object.keys(args ?? {}).join() === "value") return actionWords(verb, args);
  return [words(verb), ...Object.entries(args ?? {}).map(([key, value]) => `${key}=${value}`)].join(" ");
}

function commandRow(command) {
  const phases = command.phases ?? [];
  const last = phases.at(-1) ?? {};
  return [dateTime(phases[0]?.time ?? last.time), command.client, commandWords(command),
    phases.map((phase) => `${phase.phase} ${clock(phase.time)}`).join(" → "), last.code && last.code !== "ok" ? `[${last.code}] ${last.text ?? ""}` : last.text ?? ""];
}
