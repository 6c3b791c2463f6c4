"use strict";
for (const table of document.querySelectorAll("table.sortable")) {
  // Bodies keep their sizes: further rows stay folded away.
  const bodies = [...table.tBodies].map((body) => [body, body.rows.length]);
  const rows = () => bodies.flatMap(([body]) => [...body.rows]);
  const heads = [...table.tHead.rows[0].cells];
  const order = (column, sign) => {
    const key = (row) => row.cells[column].dataset.key;
    const number = rows().every((row) => !isNaN(Number(key(row))));
    const compare = (a, b) => {
      // What is not known comes last, whichever way.
      if (key(a) === "" || key(b) === "") return (key(a) === "") - (key(b) === "");
      return sign * (number ? Number(key(a)) - Number(key(b)) : key(a).localeCompare(key(b)));
    };
    const sorted = rows().sort(compare);
    for (const [body, size] of bodies) body.append(...sorted.splice(0, size));
  };
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = head.textContent;
    head.replaceChildren(button);
    button.addEventListener("click", () => {
      const up = head.getAttribute("aria-sort") !== "ascending";
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", up ? "ascending" : "descending");
      order(column, up ? 1 : -1);
    });
  });
}
