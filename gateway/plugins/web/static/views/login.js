// Who acts. Without a login the page only shows.

import { post } from "../api.js";
import { setText } from "../dom.js";
import { notice } from "../results.js";
import { onLogout, setSession, store } from "../store.js";

const dialog = document.getElementById("login");
const form = document.getElementById("login-form");
const wrong = document.getElementById("login-wrong");
const account = document.getElementById("account");

let closeNotice = null;

onLogout((user) => {
  closeNotice?.();
  closeNotice = notice(`${user} was logged out`,
    "The session has ended: not used for too long, or ended elsewhere. What was selected is given up. Log in again to operate.");
});

export function refreshAccount() {
  const { user, logins } = store.session;
  if (user) {
    closeNotice?.();
    closeNotice = null;
  }
  account.hidden = !logins;
  setText(account, user ? `${user}: log out` : "Log in");
}

account.addEventListener("click", async () => {
  if (!store.session.user) {
    setText(wrong, "");
    dialog.showModal();
    return;
  }
  store.isLeaving = true; // the stream may say it before the answer does
  try {
    setSession(await post("api/v1/logout"));
  } catch (error) {
    account.title = error.message;
  }
  store.isLeaving = false;
});

document.getElementById("login-cancel").addEventListener("click", () => dialog.close());

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const button = form.querySelector("[type=submit]");
  button.disabled = true;
  try {
    const session = await post("api/v1/login", { user: form.elements.user.value, password: form.elements.password.value });
    form.reset();
    dialog.close();
    setSession(session);
  } catch (error) {
    setText(wrong, error.message);
    form.elements.password.value = "";
    form.elements.password.focus();
  }
  button.disabled = false;
});
