// Values of points on hover and by keyboard, series that are switched on and off, tables that are sorted. Without it the page is
// complete but still.
"use strict";
const value = document.getElementById("value");
const shown = group => !group.classList.contains("off");
const pointsOf = group => [...group.querySelectorAll(".point")];

function say(point) {
  const at = point.getBoundingClientRect();
  value.textContent = point.getAttribute("aria-label");
  const { width, height } = value.getBoundingClientRect();
  const left = Math.min(at.right + 8, document.documentElement.clientWidth - width - 8);
  value.style.left = `${Math.max(8, left)}px`;
  value.style.top = `${at.top - height - 8 < 0 ? at.bottom + 8 : at.top - height - 8}px`;
}

function hush() { value.textContent = ""; }

// One point of a chart is reached by Tab, the others from there by the arrow keys.
function reach(svg, point) {
  for (const other of svg.querySelectorAll(".point")) other.setAttribute("tabindex", "-1");
  point?.setAttribute("tabindex", "0");
}

function move(event) {
  const point = event.target, group = point.closest(".series"), svg = group.ownerSVGElement;
  const points = pointsOf(group), place = points.indexOf(point);
  const groups = [...svg.querySelectorAll(".series")].filter(shown);
  const besides = step => {
    const next = pointsOf(groups[(groups.indexOf(group) + step + groups.length) % groups.length]);
    const away = other => Math.abs(other.getAttribute("cx") - point.getAttribute("cx"));
    return next.reduce((best, other) => away(other) < away(best) ? other : best, next[0]);
  };
  const next = {
    ArrowRight: () => points[Math.min(place + 1, points.length - 1)],
    ArrowLeft: () => points[Math.max(place - 1, 0)],
    Home: () => points[0],
    End: () => points[points.length - 1],
    ArrowDown: () => besides(1),
    ArrowUp: () => besides(-1),
  }[event.key]?.();
  if (event.key === "Escape") hush();
  if (!next) return;
  event.preventDefault();
  reach(svg, next);
  next.focus();
}

for (const svg of document.querySelectorAll("figure svg")) {
  for (const point of svg.querySelectorAll(".point")) {
    const title = point.querySelector("title");
    point.setAttribute("aria-label", title.textContent);
    title.remove();
    point.addEventListener("mouseenter", () => say(point));
    point.addEventListener("mouseleave", hush);
    point.addEventListener("focus", () => say(point));
    point.addEventListener("blur", hush);
    point.addEventListener("keydown", move);
  }
  reach(svg, svg.querySelector(".series:not(.off) .point"));
  for (const key of svg.querySelectorAll(".key")) {
    const group = svg.querySelector(`.series[data-series="${key.dataset.series}"]`);
    key.setAttribute("role", "checkbox");
    key.setAttribute("tabindex", "0");
    key.setAttribute("aria-checked", shown(group));
    const turn = event => {
      event.preventDefault();
      group.classList.toggle("off");
      key.setAttribute("aria-checked", shown(group));
      reach(svg, svg.querySelector(".series:not(.off) .point"));
    };
    key.addEventListener("click", turn);
    key.addEventListener("keydown", event => { if (event.key === " " || event.key === "Enter") turn(event); });
  }
}
addEventListener("scroll", hush, true);

for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells], body = table.tBodies[0];
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
      for (const other of heads) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", sign === 1 ? "ascending" : "descending");
      const key = row => row.cells[column].dataset.value ?? row.cells[column].textContent;
      const compare = (a, b) => a === b ? 0 : a === "" ? 1 : b === "" ? -1
        : sign * (isNaN(a) || isNaN(b) ? a.localeCompare(b) : a - b);
      body.append(...[...body.rows].sort((a, b) => compare(key(a), key(b))));
    });
  });
}
