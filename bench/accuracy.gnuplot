# gnuplot -e "directory='DIRECTORY'" accuracy.gnuplot: accuracy_bars.csv of evmarker_accuracy as DIRECTORY/accuracy.png
set terminal pngcairo size 1700,1000 font "sans,12" noenhanced
set output directory.'/accuracy.png'
set datafile separator ','
set datafile missing 'nan'
bars = directory.'/accuracy_bars.csv'
methods = (int(system("tail -n1 '".bars."' | awk -F, '{print NF}'")) - 1) / 2
scenarios = int(system("wc -l < '".bars."'")) - 1
set xrange [-0.6:scenarios - 0.4]
set style data histograms
set style histogram clustered gap 1.5
set style fill solid 0.9 noborder
set boxwidth 0.92
set logscale y
set grid ytics mytics linecolor rgb "#dddddd"
set tics nomirror scale 0.5
set xtics rotate by 20 right
array colour[9] = ["#9e9e9e", "#5b8db8", "#d62728", "#e0a030", "#8fc28f", "#3c8d3c", "#c3a3d6", "#7b4fa0", "#3d2352"]
set multiplot layout 2,1 title "Mean pose error on simulated recordings (a missing bar: never found)" font ",15"
set key outside top center horizontal maxrows 2 samplen 1.5 font ",11"
set ylabel "translation [mm]"
set yrange [0.05:100]
plot for [i=1:methods] bars using 2*i:xtic(1) linecolor rgb colour[(i - 1) % 9 + 1] title columnheader(2*i)
unset key
set ylabel "rotation [deg]"
set yrange [0.02:100]
plot for [i=1:methods] bars using 2*i+1:xtic(1) linecolor rgb colour[(i - 1) % 9 + 1] title columnheader(2*i)
unset multiplot
