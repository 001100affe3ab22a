"use strict";
// Draws every plot and view, keeps them in the colours of the page, and says so on <html data-state> when all are drawn.
(() => {
  const root = document.documentElement;
  const trouble = document.getElementById("trouble");
  function complain(message) {
    root.dataset.errors = (root.dataset.errors ? root.dataset.errors + "\n" : "") + message;
    trouble.hidden = false;
    trouble.textContent = "Part of this page could not be drawn:\n" + root.dataset.errors;
  }
  window.addEventListener("error", (event) => complain(event.message));
  window.addEventListener("unhandledrejection", (event) => complain(String(event.reason)));

  const css = (name) => getComputedStyle(root).getPropertyValue(name).trim();
  function colours(layout) {
    const axis = { gridcolor: css("--grid"), linecolor: css("--rule"), tickcolor: css("--rule") };
    const out = { paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", "font.color": css("--ink") };
    for (const key of Object.keys(layout)) {
      if (/^[xy]axis\d*$/.test(key)) for (const part of Object.keys(axis)) out[`${key}.${part}`] = axis[part];
    }
    // labels of marks hide the curves behind them
    (layout.annotations ?? []).forEach((_, k) => (out[`annotations[${k}].bgcolor`] = css("--paper")));
    out["hoverlabel.bgcolor"] = css("--raised");
    out["hoverlabel.font.color"] = css("--ink");
    out["modebar.color"] = css("--rule");
    out["modebar.activecolor"] = css("--accent");
    out["modebar.bgcolor"] = "rgba(0,0,0,0)";
    return out;
  }
  function put(layout, settings) {
    for (const [path, value] of Object.entries(settings)) {
      const keys = path.split(/[.[\]]+/).filter(Boolean);
      const last = keys.pop();
      keys.reduce((node, key) => (node[key] ??= {}), layout)[last] = value;
    }
    return layout;
  }

  const drawings = [...document.querySelectorAll(".drawing")];
  const config = { responsive: true, displaylogo: false, showSendToCloud: false, modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"] };
  async function drawPlots() {
    for (const place of drawings) {
      try {
        const figure = JSON.parse(place.firstElementChild.textContent);
        await Plotly.newPlot(place, figure.data, put(figure.layout, colours(figure.layout)), config);
      } catch (error) {
        complain(`plot: ${error.message}`);
      }
    }
  }
  const recolour = () => drawings.forEach((place) => place.layout && Plotly.relayout(place, colours(place.layout)));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
  window.addEventListener("beforeprint", recolour);
  window.addEventListener("afterprint", recolour);

  const views = [...document.querySelectorAll(".structure")].map((figure) => {
    try {
      return new StructureView(figure, css);
    } catch (error) {
      complain(`three-dimensional view: ${error.message}`);
    }
  });

  const links = new Map([...document.querySelectorAll("nav li a")].map((a) => [a.hash.slice(1), a]));
  const marked = [...links.keys()].map((id) => document.getElementById(id)).filter(Boolean);
  function follow() {
    const current = marked.filter((part) => part.getBoundingClientRect().top < innerHeight / 3).pop() ?? marked[0];
    for (const [id, link] of links) link.classList.toggle("here", id === current?.id);
  }
  addEventListener("scroll", follow, { passive: true });
  follow();

  drawPlots().then(() => {
    root.dataset.plots = String(drawings.length);
    root.dataset.views = String(views.filter(Boolean).length);
    root.dataset.state = root.dataset.errors ? "failed" : "ready";
  });
})();
