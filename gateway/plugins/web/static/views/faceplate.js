// What may be done with a starter, and why not. STOP is one click and always in the same place; what can move a
// motor is selected first, then held for a second, on the state that is shown.

import { h, setText } from "../dom.js";
import { actionWords, clock } from "../format.js";
import { carryOut, notice } from "../results.js";
import { elapsedMs, moment, store, titleOf } from "../store.js";
import { stateWords, summary } from "./overview.js";

const HOLD_MS = 1000;
const TICK_MS = 50; // while the button is held
const HICCUP_MS = 150; // after a pause so long, what was done meanwhile is looked at first
const PAUSE_MS = 700; // a page that stood still for longer has not seen whether the button was held
const SELECTED_MS = 30000; // a selection is open no longer than this on the page
const SAID_MS = 15000; // why a selection has ended
const ANSWER_MS = 5000; // to a selection; later the operator is elsewhere
const ONE_CLICK = ["reset", "lock", "unlock", "accept", "baseline", "cancel"]; // they start no motor
const FIRST = ["start", "reset", "lock", "unlock"]; // what is asked for daily
const ELSEWHERE = ["stop", "set", "read", "select", "cancel"]; // have a place of their own on the page

export class Faceplate {
  constructor(name) {
    this.name = name;
    this.stopWhy = h("span", { class: "why" });
    this.stopState = h("span", { class: "stop-state" });
    this.stop = h("button", { type: "button", class: "stop", onclick: () => this.stopNow() }, "STOP");
    this.stopName = h("strong", {}, titleOf(name));
    this.stopPlace = h("div", { class: "stop-place", role: "group", "aria-label": `Stop ${name}` },
      this.stop, this.stopName, this.stopState, this.stopWhy);
    this.others = h("div", { class: "actions" });
    this.hold = new Hold(name, () => this.refresh());
    this.lock = new Lock(name);
    this.element = h("section", { class: "faceplate", "aria-label": `Commands to ${name}` },
      this.others, this.lock.element, this.hold.element);
    this.shown = "";
  }

  close() {
    this.hold.close();
  }

  refresh() {
    const actions = store.actions ?? [];
    const stop = actions.find((action) => action.verb === "stop");
    // It stays to be pressed when the page is not live: then it tries, and says whether it arrived.
    const isForbidden = Boolean(stop && !stop.permitted && store.isLive());
    this.stop.disabled = isForbidden;
    setText(this.stopName, titleOf(this.name));
    setText(this.stopWhy, isForbidden ? stop.text : "");
    const isLive = store.isLive();
    const starter = summary(this.name);
    setText(this.stopState, stateWords({ ...starter, isGood: starter.isGood && isLive }));
    const shape = JSON.stringify([actions, isLive]);
    if (shape === this.shown) {
      this.hold.refresh();
      return;
    }
    const isOpen = this.others.querySelector("details")?.open ?? false;
    const focused = this.others.contains(document.activeElement) ? document.activeElement.dataset.action : null;
    this.shown = shape;
    const here = actions.filter((action) => !ELSEWHERE.includes(action.verb));
    const rows = (some) => some.map((action) => this.row(action, isLive));
    this.others.replaceChildren(...rows(here.filter((action) => FIRST.includes(action.verb))),
      h("details", { open: isOpen }, h("summary", {}, "More"), rows(here.filter((action) => !FIRST.includes(action.verb)))));
    if (focused) [...this.others.querySelectorAll("button")].find((each) => each.dataset.action === focused)?.focus();
    this.hold.refresh();
  }

  row(action, isLive) {
    const label = actionWords(action.verb, action.args);
    const isPermitted = action.permitted && isLive;
    const why = isPermitted ? "" : isLive ? action.text : "the page is not live";
    const isOneClick = ONE_CLICK.includes(action.verb);
    const button = h("button", {
      type: "button", disabled: !isPermitted, "data-action": `${action.verb} ${JSON.stringify(action.args ?? {})}`,
      onclick: () => {
        if (action.verb === "lock") this.lock.ask();
        else if (isOneClick) carryOut(this.name, action.verb, { args: action.args ?? {} });
        else this.hold.select(action, label);
      },
    }, isOneClick && action.verb !== "lock" ? label : `${label} …`);
    return h("div", { class: "action" }, button, h("span", { class: "why" }, why));
  }

  async stopNow() {
    this.hold.drop();
    await carryOut(this.name, "stop");
  }
}

/** A lock needs a reason, which everybody reads who wants to start the motor meanwhile. */
class Lock {
  constructor(name) {
    this.name = name;
    this.reason = h("input", { "aria-label": "Reason of the lock", placeholder: "Reason", required: true, maxlength: "200" });
    this.element = h("form", { class: "lock-form", hidden: true, onsubmit: (event) => {
      event.preventDefault();
      this.give();
    } }, this.reason, h("button", { type: "submit" }, "Lock"), h("button", { type: "button", class: "plain", onclick: () => this.close() }, "Cancel"));
  }

  ask() {
    this.element.hidden = false;
    this.reason.focus();
  }

  close() {
    this.element.hidden = true;
  }

  async give() {
    const final = await carryOut(this.name, "lock", { args: { reason: this.reason.value.trim() } });
    if (final?.phase !== "confirmed") return;
    this.reason.value = "";
    this.close();
  }
}

/** Select, then hold: two deliberate acts, on a state that the operator saw. */
class Hold {
  constructor(name, onEnd) {
    this.name = name;
    this.onEnd = onEnd;
    this.seen = h("p", { class: "seen" });
    this.fill = h("span", { class: "hold-fill" });
    this.text = h("span", { class: "hold-text" });
    this.button = h("button", { type: "button", class: "hold" }, this.fill, this.text);
    this.cancel = h("button", { type: "button", class: "plain", onclick: () => this.giveUp() }, "Cancel");
    this.element = h("div", { class: "hold-box", hidden: true, role: "group", "aria-label": "Hold to carry out" },
      this.seen, this.button, this.cancel);
    this.button.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      // A finger is captured by what it touches first; without that, sliding off ends the hold.
      if (this.button.hasPointerCapture(event.pointerId)) this.button.releasePointerCapture(event.pointerId);
      this.press();
    });
    for (const event of ["pointerup", "pointerleave", "pointercancel", "blur"]) this.button.addEventListener(event, () => this.release());
    this.button.addEventListener("contextmenu", (event) => event.preventDefault());
    this.button.addEventListener("keydown", (event) => {
      if ((event.key === " " || event.key === "Enter") && !event.repeat) this.press();
      if (event.key === " " || event.key === "Enter") event.preventDefault();
      if (event.key === "Escape") this.giveUp();
    });
    this.button.addEventListener("keyup", () => this.release());
    this.onBlur = () => this.release();
    window.addEventListener("blur", this.onBlur);
    this.selected = null;
    this.attempt = 0;
  }

  async select(action, label) {
    this.drop();
    const attempt = this.attempt;
    const state = summary(this.name);
    const asked = moment();
    const final = await carryOut(this.name, "select", { isQuiet: true, args: { verb: action.verb, args: action.args ?? {} } });
    if (attempt !== this.attempt || final?.phase !== "confirmed" || !final.select) return;
    if (elapsedMs(asked) > ANSWER_MS) {
      carryOut(this.name, "cancel", { isQuiet: true }); // it is late: ask again, on what is shown now
      return;
    }
    this.selected = { action, label, token: final.select, state: state.state, user: store.session.user,
      since: asked, validMs: Math.min((final.valid_s ?? 30) * 1000, SELECTED_MS) };
    setText(this.seen, `${label} ${titleOf(this.name)}: permitted in the state “${state.state}”, reported at ${clock(state.time)}.`);
    setText(this.text, `Hold for a second to ${label}`);
    const isElsewhere = document.activeElement?.matches("input, select, textarea"); // an operator who types keeps the focus
    this.element.hidden = false;
    this.element.scrollIntoView({ block: "nearest" });
    if (!isElsewhere) this.button.focus();
    this.refresh();
  }

  /** Ends a selection when the page is not live, its time is over, or the state or the user is another one. */
  refresh() {
    if (!this.selected) return;
    const { since, validMs, state, user, label } = this.selected;
    const now = summary(this.name).state;
    const why = !store.isLive() ? "the page is not live" : elapsedMs(since) > validMs ? "its time is over"
      : now !== state ? `the state is now “${now}”` : store.session.user !== user ? "another user is logged in" : "";
    if (!why) return;
    this.drop();
    notice(`${label} ${this.name}`, `not carried out: ${why}. Select it again.`, SAID_MS);
  }

  press() {
    if (!this.selected || this.timer) return;
    this.fill.classList.add("filling");
    const pressed = moment();
    let seen = pressed;
    this.timer = setInterval(() => {
      const pauseMs = elapsedMs(seen);
      seen = moment();
      if (pauseMs > PAUSE_MS) this.release();
      else if (pauseMs < HICCUP_MS && elapsedMs(pressed) >= HOLD_MS) this.fire();
    }, TICK_MS);
  }

  release() {
    clearInterval(this.timer);
    this.timer = null;
    this.fill.classList.remove("filling");
  }

  async fire() {
    this.release();
    this.refresh();
    const selected = this.selected;
    this.selected = null;
    this.element.hidden = true;
    if (!selected) return;
    await carryOut(this.name, selected.action.verb, { args: selected.action.args ?? {}, select: selected.token, expect: { state: selected.state } });
    this.onEnd();
  }

  /** Ends the selection at the gateway too. */
  giveUp() {
    const isOpen = this.selected !== null;
    this.drop();
    if (isOpen) carryOut(this.name, "cancel", { isQuiet: true });
  }

  close() {
    window.removeEventListener("blur", this.onBlur);
    this.drop();
  }

  drop() {
    this.attempt += 1;
    this.release();
    this.selected = null;
    this.element.hidden = true;
  }
}
