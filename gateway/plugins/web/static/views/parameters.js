// A starter's parameters: read on request; set with the old value beside the new one.

import { get } from "../api.js";
import { h, table } from "../dom.js";
import { number } from "../format.js";
import { carryOut } from "../results.js";
import { store } from "../store.js";

const AT_ONCE = 20; // parameters in one read
const MOST_ROWS = 60;

export class Parameters {
  constructor(name) {
    this.name = name;
    this.rows = null;
    this.known = new Map();
    this.search = h("input", { type: "search", placeholder: "P314, ramp …", "aria-label": "Search parameters", oninput: () => this.draw() });
    this.readAll = h("button", { type: "button", onclick: () => this.read(this.shown().map((row) => row.code)) }, "Read those shown");
    this.place = h("div");
    this.form = h("div");
    this.element = h("details", { class: "parameters", ontoggle: () => this.load() }, h("summary", {}, h("h2", {}, "Parameters")),
      h("div", { class: "tools" }, this.search, this.readAll), this.form, this.place);
  }

  async load() {
    if (!this.element.open || this.rows) return;
    try {
      this.rows = (await get(`api/v1/starter/${encodeURIComponent(this.name)}/parameters`)).rows;
      this.draw();
    } catch (error) {
      this.place.replaceChildren(h("p", { class: "wrong" }, error.message));
    }
  }

  shown() {
    const words = this.search.value.trim().toLowerCase();
    return (this.rows ?? []).filter((row) => `${row.code} ${row.name}`.toLowerCase().includes(words)).slice(0, MOST_ROWS);
  }

  draw() {
    const rows = this.shown();
    const isUser = Boolean(store.session.user);
    this.readAll.disabled = !isUser;
    this.readAll.title = isUser ? "" : "log in to read";
    const all = (this.rows ?? []).length;
    this.place.replaceChildren(table(`Parameters (${rows.length} of ${all})`, ["code", "name", "value", ""], rows.map((row) => [
      row.code, row.name, this.text(row),
      row.writable && isUser ? h("button", { type: "button", class: "plain", onclick: () => this.ask(row) }, `Set ${row.code} …`) : h("span", { class: "why" }, row.why_not ?? ""),
    ])));
  }

  text(row) {
    const value = this.known.get(row.code);
    if (!value) return "not read";
    return value.label ?? number(value.value, value.unit ?? row.unit);
  }

  async read(codes) {
    for (let at = 0; at < codes.length; at += AT_ONCE) {
      const wanted = codes.slice(at, at + AT_ONCE);
      const final = await carryOut(this.name, "read", { isQuiet: true, args: wanted.length === 1 ? { parameter: wanted[0] } : { parameters: wanted } });
      if (final?.phase !== "confirmed") return;
      if (final.values) for (const [code, value] of Object.entries(final.values)) this.known.set(code, value);
      else this.known.set(wanted[0], final);
    }
    this.draw();
  }

  async ask(row) {
    await this.read([row.code]);
    const old = this.text(row);
    const labels = Object.entries(row.labels ?? {});
    const hasRange = row.least !== undefined && row.least !== null;
    const input = labels.length && !hasRange
      ? h("select", { "aria-label": `New value of ${row.code}` }, labels.map(([value, label]) => h("option", { value: label }, `${value} ${label}`)))
      : h("input", { "aria-label": `New value of ${row.code}`, inputmode: "decimal", required: true, maxlength: "64" });
    const words = labels.map(([value, label]) => `, ${value} = ${label}`).join("");
    const limits = hasRange ? `${row.least} to ${row.most} ${row.unit ?? ""}${words}` : "";
    const form = h("form", { class: "set-form", onsubmit: (event) => {
      event.preventDefault();
      this.set(row, input.value);
    } }, h("strong", {}, `${row.code} ${row.name}`), h("span", {}, `now ${old}`), input, h("span", { class: "hint" }, limits),
    h("button", { type: "submit" }, "Set"), h("button", { type: "button", class: "plain", onclick: () => this.form.replaceChildren() }, "Cancel"));
    this.form.replaceChildren(form);
    input.focus();
  }

  async set(row, text) {
    const value = text.trim() !== "" && !Number.isNaN(Number(text)) ? Number(text) : text;
    const final = await carryOut(this.name, "set", { args: { parameter: row.code, value } });
    if (final?.phase === "confirmed") {
      this.form.replaceChildren();
      await this.read([row.code]);
    }
  }
}
