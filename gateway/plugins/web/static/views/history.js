// Values over time, the last starts over the baseline, and what came before each trip.

import { get } from "../api.js";
import { h, setText, table } from "../dom.js";
import { dateTime, number, words } from "../format.js";
import { plotStarts, plotTrace, plotTrip } from "../plot.js";
import { store } from "../store.js";

const SPANS = { "10min": ["10 min", 5000], "8h": ["8 h", 30000], "7d": ["7 d", 60000] }; // and how often each is loaded
const OVERLAID = 5; // starts beside the baseline
const UNMARKED = ["select", "cancel", "read"]; // commands that change nothing

export class History {
  constructor(name) {
    this.name = name;
    this.span = "10min";
    this.marks = { started: [], tripped: [], commands: [] }; // times
    this.plot = h("div", { class: "plot" });
    this.spans = Object.entries(SPANS).map(([span, [text]]) => h("button", { type: "button", "aria-pressed": String(span === this.span), "data-span": span, onclick: () => this.show(span) }, text));
    this.point = h("select", { "aria-label": "Point", hidden: true, onchange: () => this.loadValues() });
    this.hint = h("p", { class: "hint" });
    this.curve = h("div", { class: "plot" });
    this.curveBox = h("section", { hidden: true }, h("h2", {}, "Last start over its baseline"), this.curve);
    this.now = h("div", { class: "now" }, // stands below the state
      h("section", {}, h("h2", {}, "Values over time"), h("div", { class: "tools", role: "group", "aria-label": "Time shown" }, this.spans, this.point), this.plot, this.hint),
      this.curveBox);
    this.starts = h("div", { class: "plot" });
    this.startTable = h("div");
    this.trips = h("div");
    this.element = h("div", {},
      h("section", {}, h("h2", {}, "Last starts"), this.starts, this.startTable),
      h("section", {}, h("h2", {}, "Trips"), this.trips));
    this.startsShown = "";
    this.tripsShown = "";
    this.show(this.span);
    this.load();
  }

  show(span) {
    this.span = span;
    for (const button of this.spans) button.setAttribute("aria-pressed", String(button.dataset.span === span));
    clearInterval(this.timer);
    this.timer = setInterval(() => document.hidden || this.loadValues(), SPANS[span][1]);
    this.loadValues();
  }

  async loadValues() {
    const asked = new URLSearchParams({ span: this.span, ...(this.point.value ? { point: this.point.value } : {}) });
    let trace;
    try {
      trace = await get(`api/v1/starter/${encodeURIComponent(this.name)}/values?${asked}`);
    } catch {
      return; // the head of the page says that nothing comes
    }
    if (asked.get("span") !== this.span || (asked.get("point") ?? "") !== this.point.value) return; // another one was chosen meanwhile
    if (trace.points.length !== this.point.options.length) {
      this.point.replaceChildren(...trace.points.map((point) => h("option", { value: point, selected: point === trace.point }, words(point))));
      this.point.hidden = trace.points.length < 2;
    }
    const marks = Object.entries({ S: this.marks.started, T: this.marks.tripped, C: this.marks.commands })
      .flatMap(([letter, times]) => times.map((time) => [Date.parse(time), letter])).sort((a, b) => a[0] - b[0]);
    const isShort = this.span === "7d" && !trace.is_stored;
    setText(this.hint, `S start, T trip, C command. The band reaches from the least to the most.${isShort ? " Nothing older than 9 h is stored: see [history] in the configuration." : ""}`);
    await plotTrace(this.plot, trace, this.span === "7d", marks);
  }

  /** Marks the commands that the starter's page knows. */
  mark(commands) {
    this.marks.commands = commands.filter(({ verb }) => !UNMARKED.includes(verb)).map(({ phases }) => phases?.[0]?.time).filter(Boolean);
  }

  close() {
    clearInterval(this.timer);
  }

  async load() {
    if (this.isLoading) return;
    this.isLoading = true;
    let data;
    try {
      data = await get(`api/v1/starter/${encodeURIComponent(this.name)}/history`);
    } catch {
      return;
    } finally {
      this.isLoading = false;
    }
    const { starts = [], trips = [], started, tripped } = data;
    Object.assign(this.marks, { started, tripped });
    const startIds = starts.map((start) => start.id).join();
    if (startIds !== this.startsShown || !this.startTable.firstChild) await this.drawStarts(starts);
    this.startsShown = startIds;
    const tripIds = trips.map((trip) => trip.id).join();
    if (tripIds !== this.tripsShown || !this.trips.firstChild) this.drawTrips(trips);
    this.tripsShown = tripIds;
  }

  async drawStarts(starts) {
    this.starts.hidden = !starts.length;
    if (!starts.length) {
      this.startTable.replaceChildren(h("p", {}, "No start has been recorded yet."));
      return;
    }
    const baseline = starts.find((start) => start.is_baseline);
    const over = (some) => [...new Set([...(baseline ? [baseline] : []), ...some])].filter((start) => start.samples);
    await plotStarts(this.starts, over(starts.slice(-OVERLAID)));
    const isCurve = Boolean(starts.at(-1).samples);
    if (this.curveBox.hidden === isCurve) {
      this.curveBox.hidden = !isCurve;
      this.loadValues(); // it has another width now
    }
    await plotStarts(this.curve, over(starts.slice(-1)));
    const heads = ["time", "cause", "outcome", "acceleration", "peak", "mean", "I²t", "rate"];
    this.startTable.replaceChildren(table("Starts, newest first", heads, [...starts].reverse().map((start) => [
      dateTime(start.time) + (start.is_baseline ? " (baseline)" : ""), causeOf(start), start.outcome?.replaceAll("_", " "),
      number(start.acceleration_s ?? null, "s"), number(start.peak_a ?? null, "A"), number(start.mean_a ?? null, "A"),
      number(start.i2t_a2s ?? null, "A²s"), number(start.rate_hz ?? null, "Hz"),
    ])));
  }

  drawTrips(trips) {
    if (!trips.length) {
      this.trips.replaceChildren(h("p", {}, "No trip has been recorded yet."));
      return;
    }
    this.trips.replaceChildren(...[...trips].reverse().map((trip) => h("details", {},
      h("summary", {}, `${dateTime(trip.time)}  ${trip.code?.toUpperCase() ?? ""} ${trip.text ?? ""}`),
      this.before(trip), atFault(trip))));
  }

  /** The readings before a trip: drawn once the trip is opened, with all of them in a table below. */
  before(trip) {
    const readings = trip.readings ?? {};
    if (!readings.t_s?.length || !Object.keys(readings.points ?? {}).length) return h("p", {}, "No values were read before it.");
    const points = store.topic(`starter/${this.name}/info`)?.points ?? {};
    const units = Object.fromEntries(Object.entries(points).map(([name, about]) => [name, about.unit ?? ""]));
    const place = h("div", { class: "plot" });
    const box = h("div", {}, h("h3", {}, "Before the trip"), place, h("details", {}, h("summary", {}, "All readings"), readingsTable(readings)));
    new ResizeObserver((_, observer) => {
      if (!place.clientWidth) return; // still closed
      observer.disconnect();
      plotTrip(place, readings, units);
    }).observe(place);
    return box;
  }
}

function causeOf(start) {
  const { source, client } = start.cause ?? {};
  return client ? `${source} (${client})` : source ?? "unknown";
}

function readingsTable({ t_s: times, points }) {
  const columns = Object.entries(points);
  return table("Readings before the trip", ["seconds", ...columns.map(([name]) => name)],
    times.map((time, index) => [time.toFixed(1), ...columns.map(([, values]) => (values[index] === null || values[index] === undefined ? "" : number(values[index])))]));
}

function atFault(trip) {
  const rows = Object.entries(trip.at_fault ?? {}).map(([code, value]) => [code, value.name ?? "", number(value.value ?? null, value.unit ?? "")]);
  return rows.length ? table("Stored by the starter at the fault", ["code", "name", "value"], rows) : null;
}
